"use strict";
// Replaces each static diagram of the page by one with values under the pointer, zoom and a legend that switches curves.
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const drawn = [];

  // Index of the value of a curve that is nearest to an index of the common abscissa: not every curve has every one.
  const nearest = (plot, curve, index) => {
    const x = plot.data[0], y = plot.data[curve];
    if (curve === 0 || index == null || y[index] != null) return index;
    let low = index, high = index;
    while (low > 0 && y[low] == null) low--;
    while (high < y.length - 1 && y[high] == null) high++;
    if (y[low] == null) return high;
    if (y[high] == null) return low;
    return x[index] - x[low] <= x[high] - x[index] ? low : high;
  };

  const text = (value) => (value == null ? "–" : String(Number(value.toPrecision(6))));

  // Curves of the same name have one place in the legend: it says the least and the largest value, and switches all.
  const namesakes = (names) => names.map((name) => names.flatMap((other, k) => (other === name ? [k + 1] : [])));

  const together = (groups) => (plot, curve, { show }) => {
    if (curve === null || show === undefined) return;
    for (const other of groups[curve - 1]) if (other !== curve) plot.setSeries(other, { show }, false);
  };

  const onePlace = (groups) => (plot) => {
    const rows = plot.root.querySelectorAll(".u-legend .u-series");
    rows.forEach((row, curve) => { if (curve > 0 && groups[curve - 1][0] !== curve) row.remove(); });
  };

  const values = (group) => (plot, value, curve, index) => {
    const all = group.map((k) => plot.data[k][nearest(plot, k, index)]).filter((v) => v != null);
    if (group.length === 1 || !all.length) return text(value);
    return `${text(Math.min(...all))} to ${text(Math.max(...all))}`;
  };

  // Vertical lines with names where something happened.
  const events = (marks, ink) => (plot) => {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = ink;
    ctx.setLineDash([4, 4]);
    ctx.textAlign = "left";
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    // A name that would be written over another one stands a row lower; one without room, before its line.
    const ends = [];
    for (const [at, name] of marks) {
      const x = plot.valToPos(at, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      const length = ctx.measureText(name).width, fits = x + 4 + length <= bbox.left + bbox.width;
      const from = fits ? x + 4 : x - 4 - length;
      const free = ends.findIndex((end) => end < from), row = free < 0 ? ends.length : free;
      ends[row] = from + length;
      ctx.fillText(name, from, bbox.top + (12 + 13 * row) * devicePixelRatio);
    }
    ctx.restore();
  };

  // One finger shows values; two fingers move and stretch the abscissa.
  const touch = (plot) => {
    let begin = null;
    const places = (event) => [...event.touches].map((t) => t.clientX - plot.over.getBoundingClientRect().left);
    plot.over.addEventListener("touchstart", (event) => {
      if (event.touches.length !== 2) return;
      event.preventDefault();
      begin = places(event).map((x) => plot.posToVal(x, "x"));
    }, { passive: false });
    plot.over.addEventListener("touchmove", (event) => {
      if (event.touches.length === 1) {
        const [x] = places(event);
        plot.setCursor({ left: x, top: plot.bbox.height / 2 / devicePixelRatio });
      } else if (event.touches.length === 2 && begin) {
        event.preventDefault();
        const [a, b] = places(event), slope = (begin[1] - begin[0]) / (b - a);
        if (!Number.isFinite(slope) || slope <= 0) return;
        const min = begin[0] - a * slope;
        plot.setScale("x", { min, max: min + slope * plot.over.clientWidth });
      }
    }, { passive: false });
  };

  const draw = (figure) => {
    const spec = JSON.parse(figure.querySelector("script").textContent);
    const ink = dark.matches ? "#c3c9cf" : "#444b52", grid = dark.matches ? "#30363c" : "#e4e4e4";
    const axis = (label, size) => ({ label, size, labelSize: 20, stroke: ink, grid: { stroke: grid, width: 1 },
      ticks: { stroke: grid }, values: (_, splits) => splits.map((v) => (v == null ? "" : text(v))) });
    const width = () => Math.max(280, figure.clientWidth);
    const height = () => Math.max(220, Math.min(340, width() * 0.4));
    const groups = namesakes(spec.names);
    const curves = spec.names.map((name, k) => ({ label: name || spec.y, stroke: (dark.matches ? spec.dark : spec.light)[k],
      width: 1.3, spanGaps: true, points: { show: false }, value: values(groups[k]) }));
    const plot = new uPlot({
      width: width(), height: height(),
      scales: { x: { time: false }, y: { distr: spec.logarithmic ? 3 : 1 } },
      series: [{ label: spec.x, value: (_, v) => text(v) }, ...curves],
      axes: [axis(spec.x, 46), axis(spec.y, 64)],
      // Of so many curves no name is worth its place.
      legend: { show: new Set(spec.names).size <= 12 },
      cursor: { dataIdx: nearest, drag: { x: true, y: true, uni: 20 } },
      hooks: { draw: spec.events.length ? [events(spec.events, ink)] : [], ready: [touch, onePlace(groups)],
        setSeries: [together(groups)] },
    }, uPlot.join(spec.curves), figure.querySelector(".here"));
    const resize = new ResizeObserver(() => plot.setSize({ width: width(), height: height() }));
    resize.observe(figure);
    drawn.push(() => { resize.disconnect(); plot.destroy(); });
  };

  const all = () => {
    document.body.classList.add("drawn");
    drawn.splice(0).forEach((remove) => remove());
    document.querySelectorAll("figure[data-plot]").forEach((figure) => {
      figure.classList.add("plot");
      draw(figure);
    });
  };
  all();
  dark.addEventListener("change", all);
})();
