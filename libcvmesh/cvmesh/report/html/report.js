// SPDX-License-Identifier: AGPL-3.0-or-later
// Fills the page with the figures of the run. Texts go in as text only, never as markup.
"use strict";

(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const {report, materials, histograms} = data;
  const {input, parameters, results, timings} = report;
  const {short, grouped} = charts;
  const byId = (id) => document.getElementById(id);
  const spacing = input.spacing_mm;

  function make(name, {text, ...properties} = {}, children = []) {
    const element = Object.assign(document.createElement(name), properties);
    if (text !== undefined) element.textContent = text;
    element.append(...children);
    return element;
  }

  const count = (n) => n === undefined || n === null ? "–" : grouped(n);
  // With so many decimals, or more where only zeros would be left.
  const fixed = (value, places) =>
    value === undefined || value === null ? "–" :
    value !== 0 && Number(value.toFixed(places)) === 0 ? short(value, 1) :
    grouped(value.toFixed(places));
  const percent = (share) => (share > 0 ? "+" : share < 0 ? "−" : "") +
                             (100 * Math.abs(share)).toFixed(2) + " %";

  // --- tables ------------------------------------------------------------------------------------

  // columns: {title, unit, group, of(row) -> text or element, className}; a group spans the
  // columns side by side that name it.
  function fillTable(table, columns, rows, {rowClass, foot} = {}) {
    const head = make("thead");
    if (columns.some((column) => column.group)) {
      const groups = make("tr", {className: "groups"});
      for (let i = 0; i < columns.length;) {
        const group = columns[i].group || "";
        let span = 1;
        while (i + span < columns.length && (columns[i + span].group || "") === group) ++span;
        groups.append(make("th", {text: group, colSpan: span}));
        i += span;
      }
      head.append(groups);
    }
    head.append(make("tr", {}, columns.map(
      ({title, className}) => make("th", {text: title, className: className || ""}))));
    if (columns.some((column) => column.unit))
      head.append(make("tr", {className: "units"}, columns.map(
        ({unit, className}) => make("th", {text: unit || "", className: className || ""}))));
    const cells = (of) => columns.map((column) => {
      const value = of(column), cell = make("td", {className: column.className || ""});
      cell.append(value instanceof Node ? value : document.createTextNode(value ?? ""));
      return cell;
    });
    const body = make("tbody", {}, rows.map((row) => make(
      "tr", {className: rowClass ? rowClass(row) : ""}, cells((column) => column.of(row)))));
    table.replaceChildren(head, body);
    if (foot)
      table.append(make("tfoot", {}, [make("tr", {}, cells((column) => column.total?.() ?? ""))]));
  }

  function swatchOf(label) {
    const m = materials.findIndex((material, i) => i > 0 && material.label === label);
    const swatch = make("i", {className: "swatch"});
    if (m > 0) swatch.style.background = charts.css(charts.labelColour(m - 1));
    return swatch;
  }

  // What became of a label, in words.
  function fate(entry) {
    if (entry.merged_into !== null) {
      const heir = results.labels.find(({label}) => label === entry.merged_into);
      return `merged into ${heir ? heir.name : "label " + entry.merged_into}`;
    }
    if (entry.is_dropped) return "dropped";
    if (entry.is_outside_region) return "outside the region";
    const change = entry.voxels_kept - entry.voxels_in;
    if (change === 0) return "kept";
    return change > 0 ? `gained ${count(change)} voxels` : `lost ${count(-change)} voxels`;
  }

  function fillLabels() {
    const labels = results.labels, voxel = spacing[0] * spacing[1] * spacing[2];
    const largest = Math.max(...labels.map((entry) => entry.voxels_in * voxel));
    const [unit, scale] = largest > 2e4 ? ["cm³", 1e-3] : ["mm³", 1];
    const sum = (of) => labels.reduce((total, entry) => total + (of(entry) || 0), 0);
    const distance = (entry) => entry.distances?.to_dense?.voxels;
    const hasTets = results.mesh?.tets > 0;
    const out = (columns) => columns.map((column) => ({...column, group: "mesh"}));
    const columns = [
      {title: "label", className: "text name", total: () => "all",
       of: (entry) => make("span", {}, [swatchOf(entry.label), entry.name])},
      {title: "value", of: (entry) => String(entry.label)},
      {title: "voxels", group: "input", of: (entry) => count(entry.voxels_in),
       total: () => count(sum((entry) => entry.voxels_in))},
      {title: "volume", unit, group: "input",
       of: (entry) => short(entry.voxels_in * voxel * scale, 4),
       total: () => short(sum((entry) => entry.voxels_in) * voxel * scale, 4)},
      {title: "parts", group: "input", of: (entry) => count(entry.components_in)},
      {title: "what was done", className: "text words", of: fate},
      ...out([
        ...(hasTets ? [
          {title: "tets", of: (entry) => count(entry.tets),
           total: () => count(results.mesh.tets)},
          {title: "volume", unit,
           of: (entry) => entry.volume ? short(entry.volume.mesh_mm3 * scale, 4) : "–",
           total: () => short(sum((entry) => entry.volume?.mesh_mm3) * scale, 4)},
          {title: "change",
           of: (entry) => entry.volume ? percent(entry.volume.relative_error) : "–"},
        ] : []),
        {title: "parts", of: (entry) => count(entry.topology?.mesh.components)},
        {title: "triangles", of: (entry) => count(entry.surface_triangles),
         total: () => count(results.mesh?.surface_triangles)},
      ]),
      {title: "mean", unit: "voxels", group: "distance",
       of: (entry) => fixed(distance(entry)?.mean_symmetric, 3)},
      {title: "largest", unit: "voxels", group: "distance",
       of: (entry) => fixed(distance(entry)?.hausdorff_lower_bound, 2)},
      ...(hasTets ? [["mean", "mean"], ["least", "min"]].map(([title, key]) => ({
        title, unit: "3r/R", group: "tets",
        of: (entry) => fixed(entry.quality?.tets?.radius_ratio[key], 3)})) : []),
    ];
    const isAway = (entry) => entry.merged_into !== null || entry.is_dropped ||
                              entry.is_outside_region;
    fillTable(byId("labels"), columns, labels,
              {rowClass: (entry) => isAway(entry) ? "is-away" : "", foot: labels.length > 1});
    byId("labels-note").textContent =
      "Parts are components: of voxels with 14 neighbours, and of the mesh. " +
      "The change of volume is against the voxels that were kept. Distance is that to the dense " +
      "surface, both ways; one voxel is the smallest spacing. A triangle between two labels " +
      "counts for both.";
  }

  function fillQuality() {
    const {triangles, tets} = results.quality;
    const rows = [];
    if (tets)
      rows.push(["tets: 3r/R", "", tets.radius_ratio],
                ["tets: scaled Jacobian", "", tets.scaled_jacobian],
                ["tets: smallest dihedral angle", "°", tets.min_dihedral_deg],
                ["tets: largest dihedral angle", "°", tets.max_dihedral_deg]);
    rows.push(["triangles: 2r/R", "", triangles.radius_ratio],
              ["triangles: smallest angle", "°", triangles.min_angle_deg]);
    const figure = (title, key) => ({
      title, of: ([, unit, d]) => fixed(d[key], unit ? 1 : 3) + unit});
    fillTable(byId("quality"), [
      {title: "", className: "text", of: ([name]) => name},
      figure("mean", "mean"), figure("SD", "standard_deviation"), figure("least", "min"),
      figure("1 %", "p1"), figure("5 %", "p5"), figure("median", "p50"), figure("95 %", "p95"),
      figure("largest", "max")], rows);

    const plots = [];
    if (tets) {
      const few = [[tets.below_5_deg, "below 5°"], [tets.below_10_deg, "below 10°"],
                   [tets.above_165_deg, "above 165°"]];
      plots.push(
        charts.histogram(histograms.tet_ratio, {
          title: "Tets, 3r/R", note: "inscribed over circumscribed sphere: 1 is regular, 0 flat",
          axis: "3r/R", unit: "", what: "the tets",
          marks: [{at: tets.radius_ratio.mean, text: "mean " + fixed(tets.radius_ratio.mean, 3)}]}),
        charts.histogram(histograms.dihedral_deg, {
          title: "Tets, dihedral angles",
          note: "all six of every tet; tets with one " +
                few.map(([n, text]) => `${text}: ${count(n)}`).join(", "),
          axis: "degrees", unit: "°", what: "the angles",
          marks: [{at: tets.min_dihedral_deg.min,
                   text: "least " + fixed(tets.min_dihedral_deg.min, 1) + "°"},
                  {at: tets.max_dihedral_deg.max,
                   text: "largest " + fixed(tets.max_dihedral_deg.max, 1) + "°"}]}));
    }
    plots.push(charts.histogram(histograms.triangle_ratio, {
      title: "Surface triangles, 2r/R",
      note: "inscribed over circumscribed circle: 1 is equilateral, 0 flat", axis: "2r/R", unit: "",
      what: "the triangles",
      marks: [{at: triangles.radius_ratio.mean,
               text: "mean " + fixed(triangles.radius_ratio.mean, 3)}]}));
    byId("quality-charts").replaceChildren(...plots);
  }

  function fillDistances() {
    const {to_dense: dense, to_labels: labels} = results.distances;
    const rows = [["mesh → dense surface", dense, "mesh_to_reference"],
                  ["dense surface → mesh", dense, "reference_to_mesh"],
                  ["mesh → voxel faces", labels, "mesh_to_reference"],
                  ["voxel faces → mesh", labels, "reference_to_mesh"]];
    const figure = (title, group, space, key) => ({
      title, group, of: ([, distance, way]) => short(distance[space][way][key])});
    const keys = [["mean", "mean"], ["RMS", "rms"], ["95 %", "p95"], ["largest", "max"]];
    // Of a sheared volume grid mm are no true lengths; those of the world are there beside them.
    const mm = labels.world_mm ? "world_mm" : "mm";
    fillTable(byId("distances"), [
      {title: "", className: "text", of: ([name]) => name},
      ...keys.map(([title, key]) => figure(title, "voxels", "voxels", key)),
      ...keys.map(([title, key]) => figure(title, labels.world_mm ? "mm in the world" : "mm",
                                           mm, key))], rows);
    const mean = data.facet_distance.mean_mm;
    const grid = labels.world_mm ? ", in mm of the grid without its shear" : "";
    byId("distance-chart").replaceChildren(charts.histogram(histograms.distance_mm, {
      title: "Mesh to dense surface", note: "share of the surface's area" + grid, axis: "mm",
      unit: " mm",
      what: "the area", marks: [{at: mean, text: `mean ${short(mean)} mm`}]}));
  }

  function fillStages() {
    const stages = timings.stages, total = stages.reduce((sum, {seconds}) => sum + seconds, 0);
    fillTable(byId("stages"), [
      {title: "stage", className: "text", of: ({stage}) => stage, total: () => "all stages"},
      {title: "", className: "bar", of: ({seconds}) => {
        const bar = make("div");
        bar.style.width = `${100 * seconds / Math.max(...stages.map((s) => s.seconds))}%`;
        return bar;
      }},
      {title: "time", unit: "s", of: ({seconds}) => seconds.toFixed(2),
       total: () => total.toFixed(1)},
      {title: "share", unit: "%", of: ({seconds}) => (100 * seconds / total).toFixed(1)},
      {title: "peak memory", unit: "MiB", of: ({peak_mb}) => fixed(peak_mb, 0),
       total: () => fixed(Math.max(...stages.map((s) => s.peak_mb)), 0)},
    ], stages, {foot: true});
    return total;
  }

  // --- the rest ----------------------------------------------------------------------------------

  const kChecks = {
    surface_is_valid: "Every label's boundary is closed and manifold, and no facet is degenerate",
    surface_intersections: "No two facets intersect",
    labels_are_complete: "Every label, with every part of it, is in the mesh",
    topology_as_lattice14: "Topology of every label is that of its voxels",
    tets_are_valid: "Tets have positive volume, share whole faces and fill every label",
  };

  function fillChecks() {
    const checks = Object.entries(results.checks).map(
      ([key, value]) => ({text: kChecks[key] || key, isGood: value === true || value === 0}));
    byId("checks").replaceChildren(...checks.map(
      ({text, isGood}) => make("li", {className: isGood ? "" : "bad"}, [make("span", {text})])));
    const isGood = checks.every((check) => check.isGood);
    byId("verdict").classList.add(isGood ? "good" : "bad");
    byId("verdict").textContent = isGood ? `✓ all ${checks.length} checks passed`
                                         : "✗ a check failed";
  }

  function fillWarnings() {
    const {warnings} = results, section = byId("warnings");
    section.hidden = warnings.length === 0;
    section.querySelector("ul").replaceChildren(...warnings.map((text) => make("li", {text})));
  }

  // A parameter's value on few lines: entries without what is not set, one to a line.
  function parameterText(value) {
    if (value === null) return "not set";
    if (typeof value !== "object") return String(value);
    const compact = (part) => JSON.stringify(part, (_, item) => item === null ? undefined : item);
    const entries = Object.entries(value).filter(([, part]) => part !== null);
    if (entries.length === 0 || entries.every(([, part]) => typeof part !== "object"))
      return compact(value);
    const line = ([key, part]) => (Array.isArray(value) ? "" : `${key}: `) + compact(part);
    return entries.map(line).join("\n");
  }

  function fillParameters() {
    const changed = (key) => JSON.stringify(parameters[key]) !== JSON.stringify(data.defaults[key]);
    byId("parameters").replaceChildren(...Object.entries(parameters).map(([key, value]) => {
      const text = parameterText(value);
      const className = (changed(key) ? "is-changed " : "") + (text.length > 40 ? "is-long" : "");
      return make("div", {className}, [make("code", {text: key}), make("code", {text})]);
    }));
  }

  function fillCards(seconds) {
    const {mesh, quality} = results, dense = results.distances?.to_dense;
    const card = (figure, unit, caption) => make("div", {className: "card"}, [
      make("b", {text: figure}, unit ? [make("small", {text: " " + unit})] : []),
      make("span", {text: caption})]);
    const cards = [card(count(materials.length - 1), "", "labels meshed")];
    if (mesh.tets > 0) cards.push(card(count(mesh.tets), "", "tets"));
    cards.push(card(count(mesh.surface_vertices), "", "surface vertices"));
    cards.push(card(count(mesh.surface_triangles), "", "surface triangles"));
    if (dense)
      cards.push(card(short((dense.world_mm ?? dense.mm).mean_symmetric), "mm",
                      "mean distance to the surface, " +
                      `${short(dense.voxels.mean_symmetric, 2)} voxels`));
    cards.push(card(fixed(quality.triangles.radius_ratio.mean, 3), "2r/R",
                    "mean shape of triangles"));
    if (quality.tets)
      cards.push(card(fixed(quality.tets.radius_ratio.mean, 3), "3r/R", "mean shape of tets"),
                 card(fixed(quality.tets.min_dihedral_deg.min, 1), "°",
                      "smallest dihedral angle"));
    cards.push(card(seconds < 100 ? fixed(seconds, 1) : fixed(seconds, 0), "s",
                    `on ${timings.threads} thread${timings.threads === 1 ? "" : "s"}`));
    cards.push(card(fixed(Math.max(...timings.stages.map((stage) => stage.peak_mb)), 0), "MiB",
                    "largest memory"));
    byId("cards").replaceChildren(...cards);
  }

  function fillHead() {
    const size = input.dims.join(" × "), mm = spacing.map((s) => short(s)).join(" × ");
    document.title = `${input.file}: cvmesh report`;
    byId("title").textContent = input.file;
    byId("subtitle").textContent =
      `${size} voxels of ${mm} mm; coordinates in mm, space ${input.output_space}`;
    byId("provenance").textContent =
      `Made by cvmesh ${report.cvmesh} from ${input.file}, seed ${parameters.seed}. ` +
      "The same figures and more are in the metrics file beside this report.";
  }

  fillHead();
  fillChecks();
  fillWarnings();
  fillLabels();
  fillQuality();
  fillDistances();
  const seconds = fillStages();
  fillParameters();
  fillCards(seconds);
  viewer.start(data, byId("report-arrays").textContent);
})();
