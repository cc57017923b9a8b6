// SPDX-License-Identifier: AGPL-3.0-or-later
// The 3-D view: whole elements on one side of a plane, so that a cut shows the real faces of tets.
"use strict";

const viewer = (() => {
  const kBytes = 65535;             // 16-bit numbers of the report stand for shares of this
  const kBlank = [205, 210, 216];   // faces that the chosen quantity does not exist on
  const kShadow = 0.58, kRampShadow = 0.32;  // how dark slopes are; less where colours are read
  const kDirection = [1, -1.7, 0.75];  // of the first view, towards the eye

  // --- mesh data ---------------------------------------------------------------------------------

  // The arrays of the page by name: base64, inflated, cut up as the directory says.
  async function unpack(base64, directory) {
    const text = atob(base64.trim()), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    const buffer = await new Response(stream).arrayBuffer();
    const types = {Int32Array, Uint16Array, Float32Array};
    const arrays = {};
    for (const [name, {type, offset, length}] of Object.entries(directory))
      arrays[name] = new types[type](buffer, offset, length);
    return arrays;
  }

  // Corner coordinates in mm from the middle of the mesh, which stays apart for the sake of floats.
  function unpackPoints(mesh, packed) {
    const middle = mesh.lo.map((lo, k) => lo + mesh.step[k] * kBytes / 2);
    const points = new Float32Array(packed.length);
    for (let i = 0; i < packed.length; ++i)
      points[i] = (packed[i] - kBytes / 2) * mesh.step[i % 3];
    return {points, middle};
  }

  // The corners of every face of a tet; face k is opposite corner k.
  const kFaces = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

  // For every face of every tet (four to a tet) the tet behind it and the facet that it is, or -1.
  // Faces are sorted into buckets by their lowest corner, so that a match is near.
  function matchFaces(tets, facets, pointCount) {
    const count = tets.length;
    const low = new Int32Array(count), middle = new Int32Array(count), high = new Int32Array(count);
    const sort = (face, a, b, c) => {
      low[face] = Math.min(a, b, c);
      high[face] = Math.max(a, b, c);
      middle[face] = a + b + c - low[face] - high[face];
    };
    for (let t = 0; t < count; t += 4)
      for (let k = 0; k < 4; ++k)
        sort(t + k, tets[t + kFaces[k][0]], tets[t + kFaces[k][1]], tets[t + kFaces[k][2]]);
    const first = new Int32Array(pointCount + 1);
    for (let face = 0; face < count; ++face) ++first[low[face] + 1];
    for (let v = 0; v < pointCount; ++v) first[v + 1] += first[v];
    const next = first.slice(), bucket = new Int32Array(count);
    for (let face = 0; face < count; ++face) bucket[next[low[face]]++] = face;

    const behind = new Int32Array(count).fill(-1), facetOf = new Int32Array(count).fill(-1);
    for (let v = 0; v < pointCount; ++v) {
      for (let i = first[v]; i < first[v + 1]; ++i) {
        const face = bucket[i];
        for (let j = i + 1; j < first[v + 1] && behind[face] < 0; ++j) {
          const other = bucket[j];
          if (middle[face] !== middle[other] || high[face] !== high[other]) continue;
          behind[face] = other >> 2;
          behind[other] = face >> 2;
        }
      }
    }
    for (let f = 0; f < facets.length; f += 3) {
      const [a, b, c] = [facets[f], facets[f + 1], facets[f + 2]].sort((p, q) => p - q);
      for (let i = first[a]; i < first[a + 1]; ++i)
        if (middle[bucket[i]] === b && high[bucket[i]] === c) facetOf[bucket[i]] = f / 3;
    }
    return {behind, facetOf};
  }

  // What the view can show of a mesh of tets. Both models have the same members: `count` elements
  // of `size` `corners` each; `isSeen(e, hidden)`, whether a label of element e is to be seen;
  // `eachFace(kept, emit)`, which calls emit(element, a, b, c, facet) for every face to draw.
  function tetModel(arrays, points) {
    const {tets, tet_material: material} = arrays;
    const {behind, facetOf} = matchFaces(tets, arrays.facets, points.length / 3);
    return {
      name: "tet", names: "tets", ratioName: "3r/R",
      count: material.length, size: 4, corners: tets,
      ratio: arrays.tet_ratio, minAngle: arrays.tet_min_angle,
      isSeen: (e, hidden) => !hidden[material[e]],
      materialOf: (e) => material[e],
      eachFace(kept, emit) {
        for (let t = 0; t < material.length; ++t) {
          if (!kept[t]) continue;
          for (let k = 0; k < 4; ++k) {
            const face = 4 * t + k;
            if (behind[face] >= 0 && kept[behind[face]]) continue;
            const [a, b, c] = kFaces[k];
            emit(t, tets[4 * t + a], tets[4 * t + b], tets[4 * t + c], facetOf[face]);
          }
        }
      },
    };
  }

  // The same for a run that stopped at the surface: its facets are the elements.
  function facetModel(arrays) {
    const {facets, facet_sides: sides} = arrays;
    return {
      name: "triangle", names: "triangles", ratioName: "2r/R",
      count: facets.length / 3, size: 3, corners: facets,
      ratio: arrays.facet_ratio, minAngle: null,
      isSeen: (f, hidden) => !hidden[sides[2 * f]] ||
                             (sides[2 * f + 1] > 0 && !hidden[sides[2 * f + 1]]),
      materialOf: (f, hidden) => !hidden[sides[2 * f]] ? sides[2 * f] : sides[2 * f + 1],
      eachFace(kept, emit) {
        for (let f = 0; f < kept.length; ++f)
          if (kept[f]) emit(f, facets[3 * f], facets[3 * f + 1], facets[3 * f + 2], f);
      },
    };
  }

  function centres(model, points) {
    const result = new Float32Array(3 * model.count);
    for (let e = 0; e < model.count; ++e)
      for (let corner = 0; corner < model.size; ++corner)
        for (let axis = 0; axis < 3; ++axis)
          result[3 * e + axis] +=
            points[3 * model.corners[model.size * e + corner] + axis] / model.size;
    return result;
  }

  // --- drawing -----------------------------------------------------------------------------------

  // Flat light from the eye. The fourth number of `shade` tells the corner of the triangle, for the
  // lines along its edges, which fade where triangles are only a few pixels large.
  const kVertexShader = `
    attribute vec4 shade;
    varying vec3 vColour, vCorner, vPlace;
    void main() {
      vec4 place = modelViewMatrix * vec4(position, 1.0);
      vPlace = place.xyz;
      vColour = shade.rgb;
      vCorner = shade.a < 0.25 ? vec3(1.0, 0.0, 0.0)
              : shade.a < 0.75 ? vec3(0.0, 1.0, 0.0) : vec3(0.0, 0.0, 1.0);
      gl_Position = projectionMatrix * place;
    }`;
  const kFragmentShader = `
    uniform float edges, shadow;
    varying vec3 vColour, vCorner, vPlace;
    void main() {
      vec3 normal = normalize(cross(dFdx(vPlace), dFdy(vPlace)));
      normal *= sign(normal.z);
      float light = 1.03 - shadow * (1.0 - max(0.0, dot(normal, normalize(vec3(-0.25, 0.4, 1.0)))));
      vec3 width = fwidth(vCorner);
      vec3 away = smoothstep(vec3(0.0), 1.15 * width, vCorner);
      float line = 1.0 - min(away.x, min(away.y, away.z));
      float fade = 1.0 - smoothstep(0.06, 0.45, max(width.x, max(width.y, width.z)));
      vec3 colour = vColour * min(light, 1.0);
      gl_FragColor = vec4(mix(colour, 0.25 * colour, 0.6 * edges * line * fade), 1.0);
    }`;

  // Triangles that are filled anew with every change; the buffers grow when they must.
  class Faces {
    constructor() {
      this.geometry = new THREE.BufferGeometry();
      this.material = new THREE.ShaderMaterial({
        vertexShader: kVertexShader, fragmentShader: kFragmentShader, side: THREE.DoubleSide,
        extensions: {derivatives: true}, uniforms: {edges: {value: 1}, shadow: {value: kShadow}}});
      this.mesh = new THREE.Mesh(this.geometry, this.material);
      this.mesh.frustumCulled = false;  // no bounds to keep up to date
      this.count = 0;
      this.reserve(1 << 15);
    }

    reserve(capacity) {
      const copy = (type, old, length) => {
        const values = new type(length);
        if (old) values.set(old);
        return values;
      };
      this.capacity = capacity;
      this.positions = copy(Float32Array, this.positions, 9 * capacity);
      this.shades = copy(Uint8Array, this.shades, 12 * capacity);
      this.elements = copy(Int32Array, this.elements, capacity);
      this.facets = copy(Int32Array, this.facets, capacity);
    }

    add(points, element, a, b, c, facet, colour) {
      if (this.count === this.capacity) this.reserve(2 * this.capacity);
      const corners = [a, b, c];
      for (let k = 0; k < 3; ++k) {
        const to = 9 * this.count + 3 * k, from = 3 * corners[k], shade = 12 * this.count + 4 * k;
        this.positions[to] = points[from];
        this.positions[to + 1] = points[from + 1];
        this.positions[to + 2] = points[from + 2];
        this.shades[shade] = colour[0];
        this.shades[shade + 1] = colour[1];
        this.shades[shade + 2] = colour[2];
        this.shades[shade + 3] = 127 * k;
      }
      this.elements[this.count] = element;
      this.facets[this.count] = facet;
      ++this.count;
    }

    upload() {
      const attribute = (name, values, size, isNormalised) => {
        const present = this.geometry.attributes[name];
        if (present && present.array === values) {
          present.needsUpdate = true;
          present.updateRange.count = 3 * size * this.count;
        } else {
          this.geometry.setAttribute(
            name, new THREE.BufferAttribute(values, size, isNormalised).setUsage(
                    THREE.DynamicDrawUsage));
        }
      };
      attribute("position", this.positions, 3, false);
      attribute("shade", this.shades, 4, true);
      this.geometry.setDrawRange(0, 3 * this.count);
    }

    // The face that a ray from `from` along `along` meets first, or -1.
    hit(from, along) {
      const ray = new THREE.Ray(from, along);
      const [a, b, c, place] = [0, 1, 2, 3].map(() => new THREE.Vector3());
      let nearest = Infinity, found = -1;
      for (let n = 0; n < this.count; ++n) {
        a.fromArray(this.positions, 9 * n);
        b.fromArray(this.positions, 9 * n + 3);
        c.fromArray(this.positions, 9 * n + 6);
        if (!ray.intersectTriangle(a, b, c, false, place)) continue;
        const distance = place.distanceToSquared(from);
        if (distance < nearest) [nearest, found] = [distance, n];
      }
      return found;
    }
  }

  function lines(colour, isOnTop) {
    const material = new THREE.LineBasicMaterial(
      {color: colour, depthTest: !isOnTop, transparent: true});
    const object = new THREE.LineSegments(new THREE.BufferGeometry(), material);
    object.frustumCulled = false;
    object.visible = false;
    object.renderOrder = isOnTop ? 1 : 0;
    return object;
  }

  // --- the view ----------------------------------------------------------------------------------

  const byId = (id) => document.getElementById(id);
  const millimetres = (value, places) => value.toFixed(places).replace("-", "−") + " mm";

  function hasWebGL() {
    const context = document.createElement("canvas").getContext("webgl");
    return context !== null && context.getExtension("OES_standard_derivatives") !== null;
  }

  class View {
    constructor(data, arrays) {
      this.data = data;
      this.arrays = arrays;
      const {points, middle} = unpackPoints(data.mesh, arrays.points);
      this.points = points;
      this.middle = middle;
      this.half = data.mesh.step.map((step) => step * kBytes / 2);
      this.model = arrays.tets.length > 0 ? tetModel(arrays, points) : facetModel(arrays);
      this.centres = centres(this.model, points);
      this.kept = new Uint8Array(this.model.count);
      this.hidden = new Uint8Array(data.materials.length);
      this.hidden[0] = 1;
      this.quantities = this.makeQuantities();
      this.quantity = this.quantities[0];
      this.cut = {isOn: true, axis: 1, at: 0.5, keepsAbove: true};
      this.mostRatio = 1;

      this.canvas = byId("canvas");
      this.renderer = new THREE.WebGLRenderer(
        {canvas: this.canvas, antialias: true, alpha: true, preserveDrawingBuffer: true});
      this.renderer.setClearColor(0, 0);
      this.scene = new THREE.Scene();
      this.faces = new Faces();
      this.frame = lines(0x7b8794, false);
      this.picked = lines(0xd9480f, true);
      this.scene.add(this.faces.mesh, this.frame, this.picked);
      this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0, 1);
      this.camera.up.set(0, 0, 1);
      this.controls = new THREE.OrbitControls(this.camera, this.canvas);
      this.controls.screenSpacePanning = true;
      this.controls.addEventListener("change", () => this.invalidate());
      this.isStale = true;
      this.connect();
      this.resize();
      this.look(kDirection);
      new ResizeObserver(() => this.resize()).observe(this.canvas.parentElement);
    }

    // What elements can be coloured by: `colour(element, facet)`, and what the legend says.
    makeQuantities() {
      const {model, arrays} = this;
      const labelColours =
        this.data.materials.map((_, m) => charts.labelColour(Math.max(0, m - 1)));
      // A table per ramp is much faster than interpolation for every face.
      const ramped = (ramp, share) => {
        const table = Array.from({length: 256}, (_, i) => charts.rampColour(ramp, i / 255));
        return (element, facet) => {
          const s = share(element, facet);
          return s < 0 ? kBlank : table[Math.min(255, Math.floor(255 * s))];
        };
      };
      const quantities = [
        {title: "label", colour: (element) => labelColours[model.materialOf(element, this.hidden)]},
        {title: `quality, ${model.ratioName}`, ramp: "quality", lo: 0, hi: 1, unit: "",
         colour: ramped(charts.kRamps.quality, (e) => model.ratio[e] / kBytes)},
      ];
      const kRegularDegrees = 70.53;  // the dihedral angle of a regular tet
      if (model.minAngle)
        quantities.push({
          title: "smallest dihedral angle", ramp: "quality", lo: 0, hi: kRegularDegrees, unit: "°",
          colour: ramped(charts.kRamps.quality,
                         (e) => model.minAngle[e] / kBytes * 180 / kRegularDegrees)});
      // Single facets are much farther away than all others: the ramp ends before them.
      const sorted = arrays.facet_distance.slice().sort();
      const hi = sorted[Math.floor(0.99 * (sorted.length - 1))] || 1;
      quantities.push({
        title: "distance to the dense surface", ramp: "distance", lo: 0, hi, unit: " mm",
        isOpen: true,
        colour: ramped(charts.kRamps.distance,
                       (_, facet) => facet < 0 ? -1 : arrays.facet_distance[facet] / hi)});
      return quantities;
    }

    // --- what is shown

    select() {
      const {model, kept, hidden, centres, cut} = this;
      const most = this.mostRatio * kBytes;
      const place = (2 * cut.at - 1) * this.half[cut.axis];
      let count = 0;
      for (let e = 0; e < model.count; ++e) {
        const side = centres[3 * e + cut.axis] - place;
        kept[e] = (!cut.isOn || (cut.keepsAbove ? side >= 0 : side <= 0)) &&
                  model.ratio[e] <= most && model.isSeen(e, hidden) ? 1 : 0;
        count += kept[e];
      }
      return count;
    }

    update() {
      const {model, faces, points, quantity} = this;
      const count = this.select();
      faces.count = 0;
      model.eachFace(this.kept, (element, a, b, c, facet) =>
        faces.add(points, element, a, b, c, facet, quantity.colour(element, facet)));
      faces.upload();
      this.pick(-1);
      this.drawFrame();
      byId("shown").textContent =
        `Shown: ${charts.grouped(count)} of ${charts.grouped(model.count)} ${model.names}. ` +
        "A cut leaves out whole " + model.names + ", so what it shows are elements of the mesh." +
        (this.data.mesh.tets_left_out > 0 ?
          ` The view has the surface only: ${charts.grouped(this.data.mesh.tets_left_out)} tets ` +
          "are too many for it." : "");
      this.canvas.dataset.elements = count;
    }

    // The outline of the cut plane.
    drawFrame() {
      const {axis, at, isOn} = this.cut, [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      const corner = (s, t) => {
        const p = [0, 0, 0];
        p[axis] = (2 * at - 1) * this.half[axis];
        p[u] = 1.04 * s * this.half[u];
        p[v] = 1.04 * t * this.half[v];
        return p;
      };
      const ring = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
      const ends = ring.flatMap((p, k) => [...p, ...ring[(k + 1) % 4]]);
      this.frame.geometry.setAttribute(
        "position", new THREE.BufferAttribute(new Float32Array(ends), 3));
      this.frame.visible = isOn;
      const place = this.middle[axis] + (2 * at - 1) * this.half[axis];
      byId("cut-value").textContent = isOn ? `${"xyz"[axis]} = ${millimetres(place, 1)}` : "off";
    }

    // Outlines the element behind face n of what is drawn and tells its figures; -1: none.
    pick(n) {
      const probe = byId("probe"), {model, arrays, points} = this;
      this.picked.visible = n >= 0;
      probe.hidden = n < 0;
      if (n < 0) return;
      const e = this.faces.elements[n], facet = this.faces.facets[n], ends = [];
      for (let i = 0; i < model.size; ++i)
        for (let j = i + 1; j < model.size; ++j)
          for (const corner of [i, j]) {
            const at = 3 * model.corners[model.size * e + corner];
            ends.push(points[at], points[at + 1], points[at + 2]);
          }
      this.picked.geometry.setAttribute(
        "position", new THREE.BufferAttribute(new Float32Array(ends), 3));
      const material = this.data.materials[model.materialOf(e, this.hidden)];
      const rows = [[model.name, charts.grouped(e)],
                    [model.ratioName, (model.ratio[e] / kBytes).toFixed(3)]];
      if (model.minAngle)
        rows.push(["smallest dihedral", (model.minAngle[e] / kBytes * 180).toFixed(1) + "°"]);
      if (facet >= 0)
        rows.push(["largest distance", charts.short(arrays.facet_distance[facet]) + " mm"]);
      for (let axis = 0; axis < 3; ++axis)
        rows.push([`centre ${"xyz"[axis]}`,
                   millimetres(this.middle[axis] + this.centres[3 * e + axis], 2)]);
      const title = document.createElement("b"), list = document.createElement("dl");
      title.textContent = `${material.name} (label ${material.label})`;
      for (const [name, value] of rows) {
        const term = document.createElement("dt"), text = document.createElement("dd");
        term.textContent = name;
        text.textContent = value;
        list.append(term, text);
      }
      probe.replaceChildren(title, list);
    }

    // --- the camera

    resize() {
      const {clientWidth: width, clientHeight: height} = this.canvas.parentElement;
      if (width === 0 || height === 0) return;
      this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
      this.renderer.setSize(width, height, false);
      const halfHeight = this.camera.top;
      this.camera.left = -halfHeight * width / height;
      this.camera.right = halfHeight * width / height;
      this.camera.updateProjectionMatrix();
      this.invalidate();
    }

    // Looks from a direction at the whole mesh, as large as it fits.
    look(direction) {
      const {camera, half} = this, radius = Math.hypot(...half) || 1;
      const {clientWidth: width, clientHeight: height} = this.canvas.parentElement;
      camera.position.fromArray(direction).setLength(4 * radius);
      this.controls.target.set(0, 0, 0);
      camera.zoom = 1;
      camera.near = -20 * radius;
      camera.far = 40 * radius;
      camera.lookAt(0, 0, 0);
      camera.updateMatrixWorld();
      const [right, up] = this.cameraAxes();
      const reach = (axis) => axis.reduce((sum, x, k) => sum + Math.abs(x) * half[k], 0);
      camera.top = 1.1 * Math.max(reach(up), reach(right) * height / width) || 1;
      camera.bottom = -camera.top;
      this.resize();
      this.controls.update();
      this.invalidate();
    }

    // The world directions that point right and up in the picture.
    cameraAxes() {
      const m = this.camera.matrixWorld.elements;
      return [[m[0], m[1], m[2]], [m[4], m[5], m[6]]];
    }

    // Keeps the side of the cut that turns its cut faces to the eye.
    faceCut() {
      this.cut.keepsAbove =
        this.camera.position.getComponent(this.cut.axis) <
        this.controls.target.getComponent(this.cut.axis);
    }

    invalidate(isStale = false) {
      this.isStale = this.isStale || isStale;
      if (this.isWaiting) return;
      this.isWaiting = true;
      requestAnimationFrame(() => this.draw());
    }

    draw() {
      this.isWaiting = false;
      if (this.isStale) this.update();
      this.isStale = false;
      this.renderer.render(this.scene, this.camera);
      this.drawTriad();
      this.drawScale();
    }

    drawTriad() {
      const [right, up] = this.cameraAxes();
      const space = this.data.report.input.output_space;
      const towards = /^[RL][AP][SI]$/.test(space) ? space : "";
      const colours = ["#b3261e", "#22754c", "#2b6a9c"];
      byId("triad").replaceChildren(...[0, 1, 2].flatMap((axis) => {
        const [x, y] = [28 * right[axis], -28 * up[axis]];
        return [charts.svg("line", {x1: 0, y1: 0, x2: x, y2: y, stroke: colours[axis],
                                    "stroke-width": 2}),
                charts.svg("text", {x: 1.35 * x, y: 1.35 * y, fill: colours[axis]},
                           "xyz"[axis] + (towards ? " " + towards[axis] : ""))];
      }));
    }

    drawScale() {
      const {camera} = this, height = this.canvas.clientHeight;
      const pixels = height * camera.zoom / (camera.top - camera.bottom);
      const length = charts.niceStep(110 / pixels, 1);
      const bar = byId("scale");
      bar.style.width = `${length * pixels}px`;
      bar.firstElementChild.textContent = `${charts.short(length, 1)} mm`;
    }

    drawLegend() {
      const {ramp, lo, hi, unit, title, isOpen} = this.quantity, legend = byId("legend");
      legend.hidden = !ramp;
      if (!ramp) return;
      const heading = document.createElement("b");
      const bar = document.createElement("div"), ticks = document.createElement("div");
      heading.textContent = title;
      bar.className = "ramp";
      bar.style.background = `linear-gradient(to right, ${charts.kRamps[ramp].map(charts.css)})`;
      ticks.className = "ticks";
      const places = hi > 10 ? 0 : Math.max(0, 2 - Math.ceil(Math.log10(hi)));
      for (const value of [lo, (lo + hi) / 2, hi]) {
        const tick = document.createElement("span");
        tick.textContent = (isOpen && value === hi ? "≥ " : "") + value.toFixed(places) + unit;
        ticks.append(tick);
      }
      legend.replaceChildren(heading, bar, ticks);
    }

    // --- the controls beside the picture

    connect() {
      const on = (id, event, action) => byId(id).addEventListener(event, (e) => {
        action(byId(id), e);
        this.invalidate(true);
      });
      this.fillColours();
      this.fillLabels();
      this.connectCut(on);
      byId("worst-title").textContent =
        `Only ${this.model.names} with ${this.model.ratioName} up to`;
      byId("worst-value").textContent = "all";
      on("worst", "input", (slider) => {
        this.mostRatio = slider.value / 100;
        byId("worst-value").textContent =
          slider.value === "100" ? "all" : this.mostRatio.toFixed(2);
      });
      on("edges", "change",
         (box) => this.faces.material.uniforms.edges.value = box.checked ? 1 : 0);
      const views = {reset: kDirection, x: [1, 0, 0], y: [0, -1, 0], z: [0, -1e-4, 1]};
      for (const button of document.querySelectorAll("[data-view]"))
        button.addEventListener("click", () => this.look(views[button.dataset.view]));
      byId("save").addEventListener("click", () => this.save());
      this.connectProbe();
    }

    fillColours() {
      const choice = byId("colour-by");
      this.quantities.forEach((quantity, n) => choice.append(new Option(quantity.title, n)));
      choice.addEventListener("change", () => {
        this.quantity = this.quantities[choice.value];
        this.faces.material.uniforms.shadow.value = this.quantity.ramp ? kRampShadow : kShadow;
        this.drawLegend();
        this.invalidate(true);
      });
    }

    fillLabels() {
      const list = byId("label-list"), boxes = [];
      this.data.materials.forEach(({name, label}, m) => {
        if (m === 0) return;
        const row = document.createElement("label"), box = document.createElement("input");
        const swatch = document.createElement("i"), text = document.createElement("span");
        box.type = "checkbox";
        box.checked = true;
        swatch.className = "swatch";
        swatch.style.background = charts.css(charts.labelColour(m - 1));
        text.textContent = name;
        row.title = `${name} (label ${label})`;
        row.append(box, swatch, text);
        list.append(row);
        boxes.push(box);
        box.addEventListener("change", () => {
          this.hidden[m] = box.checked ? 0 : 1;
          this.invalidate(true);
        });
      });
      const setAll = (isSeen) => {
        for (const box of boxes) box.checked = isSeen;
        this.hidden.fill(isSeen ? 0 : 1, 1);
        this.invalidate(true);
      };
      byId("labels-all").addEventListener("click", () => setAll(true));
      byId("labels-none").addEventListener("click", () => setAll(false));
    }

    connectCut(on) {
      const {cut} = this;
      byId("cut-on").checked = cut.isOn;
      on("cut-on", "change", (box) => cut.isOn = box.checked);
      on("cut-at", "input", (slider) => cut.at = slider.value / 1000);
      on("cut-flip", "click", () => cut.keepsAbove = !cut.keepsAbove);
      for (const choice of document.querySelectorAll("[name=cut-axis]")) {
        choice.checked = Number(choice.value) === cut.axis;
        choice.addEventListener("change", () => {
          cut.axis = Number(choice.value);
          this.faceCut();
          this.invalidate(true);
        });
      }
    }

    // A click, and not the end of a drag, asks for the element under it.
    connectProbe() {
      const {canvas} = this;
      let start = null;
      canvas.addEventListener("pointerdown", (event) => start = [event.clientX, event.clientY]);
      canvas.addEventListener("pointerup", (event) => {
        const isClick = start && event.button === 0 &&
                        Math.hypot(event.clientX - start[0], event.clientY - start[1]) < 4;
        start = null;
        if (!isClick) return;
        const box = canvas.getBoundingClientRect();
        const x = 2 * (event.clientX - box.left) / box.width - 1;
        const y = 1 - 2 * (event.clientY - box.top) / box.height;
        const caster = new THREE.Raycaster();
        caster.setFromCamera(new THREE.Vector2(x, y), this.camera);
        this.pick(this.faces.hit(caster.ray.origin, caster.ray.direction));
        this.invalidate();
      });
    }

    // The picture on white, as a file.
    save() {
      const flat = document.createElement("canvas"), context = flat.getContext("2d");
      flat.width = this.canvas.width;
      flat.height = this.canvas.height;
      context.fillStyle = "#fff";
      context.fillRect(0, 0, flat.width, flat.height);
      context.drawImage(this.canvas, 0, 0);
      const link = document.createElement("a");
      link.download = this.data.report.input.file.replace(/\..*$/, "") + ".png";
      link.href = flat.toDataURL("image/png");
      link.click();
    }
  }

  // Draws the mesh; where the browser cannot, says so in its place.
  async function start(data, base64) {
    const message = byId("viewer-message");
    const giveUp = (why) => {
      message.textContent = `${why} All tables and plots of this report are below.`;
      byId("viewer").classList.add("is-flat");
      document.documentElement.dataset.viewer = "flat";
    };
    if (!hasWebGL())
      return giveUp("The 3-D view needs WebGL, which this browser does not offer.");
    if (typeof DecompressionStream === "undefined")
      return giveUp("The 3-D view needs a browser of 2023 or newer.");
    const view = new View(data, await unpack(base64, data.mesh.arrays));
    view.draw();
    message.hidden = true;
    document.documentElement.dataset.viewer = "ready";
    return view;
  }

  return {start};
})();
