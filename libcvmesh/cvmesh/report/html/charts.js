// SPDX-License-Identifier: AGPL-3.0-or-later
// Plots of the report as SVG elements, and the ramps of colour that plots and the view share.
"use strict";

const charts = (() => {
  const kWidth = 380, kHeight = 210;
  const kLeft = 46, kRight = 10, kTop = 14, kBottom = 36;

  function svg(name, attributes, text) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    if (text !== undefined) element.textContent = text;
    return element;
  }

  // A step of 1, 2 or 5 times a power of ten that cuts `span` into about `count` parts.
  function niceStep(span, count) {
    const rough = span / count;
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    return power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
  }

  // A number short enough for an axis or a table: about `digits` significant ones.
  function short(value, digits = 3) {
    if (value === null || value === undefined || !isFinite(value)) return "–";
    if (value === 0) return "0";
    const places = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
    return places > 8 ? value.toExponential(1) : grouped(value.toFixed(Math.min(8, places)));
  }

  // The multiples of `step` from `from` to `to`, with as many decimals as the step needs.
  function ticks(from, to, step) {
    const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), result = [];
    for (let n = Math.ceil(from / step - 1e-9); n * step <= to + 1e-9 * step; ++n)
      result.push({at: n * step, text: (n * step).toFixed(places)});
    return result;
  }

  // Thousands apart by narrow spaces.
  function grouped(text) {
    const [whole, part] = String(text).split(".");
    const spaced = whole.replace(/\B(?=(\d{3})+$)/g, "\u202f");
    return part === undefined ? spaced : spaced + "." + part;
  }

  // A figure with the share of the total weight in every bin, in percent.
  //   options: title, note, unit (of x), marks [{at, text}], what (of the weights)
  function histogram(data, options) {
    const total = data.weights.reduce((sum, w) => sum + w, 0) || 1;
    const percent = data.weights.map((w) => 100 * w / total);
    const highest = Math.max(...percent, 1e-9);
    const stepY = niceStep(highest, 4), top = Math.ceil(highest / stepY - 1e-9) * stepY;
    const x = (v) => kLeft + (v - data.lo) / (data.hi - data.lo) * (kWidth - kLeft - kRight);
    const y = (v) => kHeight - kBottom - v / top * (kHeight - kTop - kBottom);
    const picture = svg("svg", {class: "chart", viewBox: `0 0 ${kWidth} ${kHeight}`, role: "img",
                                "aria-label": options.title});
    for (const {at, text} of ticks(0, top, stepY)) {
      picture.append(
        svg("line", {class: at === 0 ? "axis" : "grid", x1: kLeft, x2: kWidth - kRight, y1: y(at),
                     y2: y(at)}),
        svg("text", {x: kLeft - 6, y: y(at) + 4, "text-anchor": "end"}, text + " %"));
    }
    for (const {at, text} of ticks(data.lo, data.hi, niceStep(data.hi - data.lo, 6))) {
      picture.append(
        svg("line", {class: "axis", x1: x(at), x2: x(at), y1: y(0), y2: y(0) + 4}),
        svg("text", {x: x(at), y: y(0) + 16, "text-anchor": "middle"}, text));
    }
    const width = (data.hi - data.lo) / data.weights.length;
    percent.forEach((p, bin) => {
      if (p === 0) return;
      const from = data.lo + bin * width, height = Math.max(0.6, y(0) - y(p));
      const bar = svg("rect", {class: "bar", x: x(from) + 0.4, y: y(0) - height, height,
                               width: Math.max(0.5, x(from + width) - x(from) - 0.8)});
      bar.append(svg("title", {}, `${short(from)} to ${short(from + width)}${options.unit}: ` +
                                  `${short(p)} % of ${options.what}`));
      picture.append(bar);
    });
    for (const mark of options.marks || []) {
      const right = x(mark.at) > kWidth * 0.7;
      picture.append(
        svg("line", {class: "mark", x1: x(mark.at), x2: x(mark.at), y1: kTop - 6, y2: y(0)}),
        svg("text", {class: "mark-text", x: x(mark.at) + (right ? -4 : 4), y: kTop + 2,
                     "text-anchor": right ? "end" : "start"}, mark.text));
    }
    picture.append(svg("text", {x: (kLeft + kWidth - kRight) / 2, y: kHeight - 4,
                                "text-anchor": "middle"}, options.axis));
    const figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = options.title;
    const note = document.createElement("small");
    note.textContent = options.note;
    caption.append(note);
    figure.append(caption, picture);
    return figure;
  }

  // --- colours -----------------------------------------------------------------------------------
  // Ramps after ColorBrewer's RdYlBu and YlOrRd (for the colour-blind, too), [r, g, b] of 0..255.
  const kRamps = {
    quality: [[165, 0, 38], [215, 48, 39], [244, 109, 67], [253, 174, 97], [254, 224, 144],
              [224, 243, 248], [171, 217, 233], [116, 173, 209], [69, 117, 180]],
    distance: [[250, 248, 235], [255, 237, 160], [254, 217, 118], [254, 178, 76], [253, 141, 60],
               [252, 78, 42], [227, 26, 28], [177, 0, 38], [103, 0, 31]],
  };

  function rampColour(ramp, share) {
    const place = Math.min(1, Math.max(0, share)) * (ramp.length - 1);
    const low = Math.min(ramp.length - 2, Math.floor(place)), part = place - low;
    return [0, 1, 2].map(
      (k) => Math.round(ramp[low][k] + part * (ramp[low + 1][k] - ramp[low][k])));
  }

  // Colours of labels: quiet and apart; after the list, hues by the golden angle.
  const kLabelColours = [[78, 121, 167], [225, 166, 97], [120, 170, 104], [199, 96, 92],
                         [232, 219, 186], [148, 117, 168], [95, 165, 165], [214, 146, 166],
                         [141, 113, 91], [166, 172, 84]];

  function labelColour(index) {
    if (index < kLabelColours.length) return kLabelColours[index];
    const hue = (index * 137.508) % 360, light = 0.52 + 0.12 * (index % 3);
    const channel = (shift) => {
      const k = (shift + hue / 30) % 12;
      return Math.round(255 * (light - 0.38 * Math.min(light, 1 - light) *
                               Math.max(-1, Math.min(k - 3, 9 - k, 1))));
    };
    return [channel(0), channel(8), channel(4)];
  }

  const css = (colour) => `rgb(${colour.join(",")})`;

  return {svg, niceStep, short, grouped, histogram, kRamps, rampColour, labelColour, css};
})();
