"use strict";
(() => {  // draws the data of report/space.py
  const id = name => document.getElementById(name);
  const data = JSON.parse(id("space-data").textContent);
  const [plot, slider, menu, solid, play] =
    ["space", "space-step", "space-quantity", "space-conductors", "space-play"].map(id);
  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  const between = ([low, high]) => k => low + (high > low ? high - low : 1) * k / 65535;
  const axes = data.ends[0].length;
  const along = [...Array(axes).keys()].map(j => between([data.ends[0][j], data.ends[1][j]]));

  const widths = data.box.map(([low, high]) => high - low);
  const sizes = widths.map(width => width / Math.hypot(...widths));
  const LARGE = 2.2;  // diagonal of the box, in the units of the camera's place

  for (const part of data.parts) {
    const corners = [[], [], []];
    part.n = 0;
    for (const patch of part.patches) {
      const triangles = new Uint32Array(bytes(patch.triangles));
      triangles.forEach((corner, k) => corners[k % 3].push(part.n + corner));
      patch.points = new Uint16Array(bytes(patch.points));
      for (const name in patch.values)
        patch.values[name] = new Uint16Array(bytes(patch.values[name]));
      part.n += patch.n * patch.maps.length;
    }
    part.corners = corners;
  }

  function trace(part, step, quantity) {
    const [x, y, z, values] = [0, 1, 2, 3].map(() => new Float32Array(part.n));
    const read = between(quantity.ends), point = new Float32Array(axes);
    const coloured = part.patches.every(patch => quantity.name in patch.values);
    let at = 0;
    for (const {n, maps, points, values: all} of part.patches)
      for (const map of maps)
        for (let i = step * n; i < (step + 1) * n; i++, at++) {
          for (let j = 0; j < axes; j++) point[j] = along[j](points[i * axes + j]);
          [x, y, z].forEach((to, k) => to[at] = map[k].reduce((sum, m, j) => sum + m * point[j], 0));
          if (coloured) values[at] = read(all[quantity.name][i]);
        }
    const [i, j, k] = part.corners;
    const found = {type: "mesh3d", x, y, z, i, j, k, flatshading: true, showscale: false,
      visible: !part.conductor || solid.checked, hovertemplate:
        "x %{x:.4g} mm<br>y %{y:.4g} mm<br>z %{z:.4g} mm" + (coloured ? "<br>%{text}" : "") + "<extra></extra>",
      lighting: {ambient: 0.65, diffuse: 0.5, specular: 0.05, roughness: 0.9,
        facenormalsepsilon: 0},  // else small triangles have no normals, and are dark
      lightposition: {x: 20000, y: -40000, z: 80000}};
    if (!coloured) return {...found, color: part.plain};
    const unit = quantity.unit && ` ${quantity.unit}`;
    return {...found, intensity: values, text: Array.from(values, v => v.toPrecision(4) + unit),
      colorscale: quantity.colours, cmin: quantity.range[0], cmax: quantity.range[1],
      showscale: !part.conductor,
      colorbar: {title: {text: quantity.unit}, thickness: 14, len: 0.8}};
  }

  function crests(step, quantity) {
    const [x, y, z] = [[], [], []], lines = data.crests;
    if (lines && lines.name === quantity.name) {
      const read = [x, y, z].map((_, k) => between([lines.ends[0][k], lines.ends[1][k]]));
      new Uint16Array(bytes(lines.steps[step])).forEach((value, at) => {
        const to = [x, y, z][at % 3];
        to.push(read[at % 3](value));
        if (at % 6 > 2) to.push(null);  // a line ends
      });
    }
    return {type: "scatter3d", mode: "lines", x, y, z, hoverinfo: "skip",
      line: {color: lines?.colour, width: 3}};
  }

  function whole() {  // from where the whole box is seen: the camera's picture is 45 degrees high
    const from = [1.15, -1.55, 1.2], far = Math.hypot(...from), ahead = from.map(x => x / far);
    const flat = Math.hypot(ahead[0], ahead[1]), right = [-ahead[1] / flat, ahead[0] / flat, 0];
    const up = [-ahead[2] * right[1], ahead[2] * right[0], flat];
    const high = Math.tan(Math.PI / 8), wide = high * plot.clientWidth / plot.clientHeight;
    let needed = far;
    for (let corner = 0; corner < 8; corner += 1) {
      const at = sizes.map((size, k) => LARGE / 2 * size * (corner >> k & 1 ? 1 : -1));
      const along = axis => at.reduce((sum, x, k) => sum + x * axis[k], 0);
      const reach = Math.max(Math.abs(along(right)) / wide, Math.abs(along(up)) / high);
      needed = Math.max(needed, 1.03 * reach + along(ahead));
    }
    const [x, y, z] = ahead.map(part => needed * part);
    return {x, y, z};
  }
  const eye = whole();

  function draw() {
    const step = Number(slider.value), quantity = data.quantities[menu.selectedIndex];
    const style = getComputedStyle(document.body), ink = style.color;
    const axis = (title, k) => ({title: {text: `${title} (mm)`}, range: data.box[k],
      nticks: Math.round(2 + 6 * sizes[k]),
      backgroundcolor: "rgba(0,0,0,0)", gridcolor: "rgba(128,128,128,0.35)", color: ink});
    id("space-label").textContent = data.labels[step];
    const traces = data.parts.map(part => trace(part, step, quantity));
    Plotly.react(plot, [...traces, crests(step, quantity)], {
      uirevision: "kept", margin: {l: 0, r: 0, t: 0, b: 0}, paper_bgcolor: "rgba(0,0,0,0)",
      font: {color: ink, family: style.fontFamily}, showlegend: false,
      scene: {aspectmode: "manual", aspectratio: {x: LARGE * sizes[0], y: LARGE * sizes[1], z: LARGE * sizes[2]},
        xaxis: axis("x", 0), yaxis: axis("y", 1), zaxis: axis("z", 2),
        camera: {eye}},
      modebar: {bgcolor: "rgba(0,0,0,0)", color: "rgba(128,128,128,0.7)", activecolor: ink},
    }, {responsive: true, displaylogo: false, scrollZoom: true,
      modeBarButtons: [["toImage"], ["zoom3d", "pan3d", "tableRotation", "resetCameraDefault3d"]]});
  }

  let waiting = false, timer = 0;
  function ask() {  // draws once for all that happens in a short time
    if (!waiting) setTimeout(() => { waiting = false; draw(); }, 20);
    waiting = true;
  }
  for (const quantity of data.quantities) menu.add(new Option(quantity.title));
  slider.max = data.labels.length - 1;
  slider.value = data.start;
  id("space-note").textContent = data.note;
  solid.parentElement.hidden = !data.parts.some(part => part.conductor);
  for (const part of [slider, menu, solid]) part.addEventListener("input", ask);
  play.addEventListener("click", () => {
    timer = timer ? clearInterval(timer) : setInterval(() => {
      slider.value = (Number(slider.value) + 1) % data.labels.length;
      ask();
    }, 250);
    play.textContent = timer ? "Stop" : "Play";
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
  draw();
})();
