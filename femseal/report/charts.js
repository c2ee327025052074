/* Curves of the page that can be hovered and zoomed; without scripts and on paper their pictures stand there. */
for (const figure of document.querySelectorAll("figure.chart")) {
  const chart = JSON.parse(figure.querySelector("script").textContent);
  const place = figure.insertBefore(document.createElement("div"), figure.firstChild);
  const power = ([m, e]) => (m === "1" ? "" : m + "·") + "10" + [...String(+e)].map(c => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c] ?? "⁻").join("");
  const number = v => v == null ? "" : v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5) ? power(v.toExponential(0).split("e")) : String(+v.toPrecision(4));
  const size = () => ({ width: figure.clientWidth, height: Math.max(300, Math.min(440, 0.72 * figure.clientWidth)) });
  // powers of ten, with 2 and 5 between few of them
  const decades = (u, n, low, high) => {
    const found = [], mantissas = high > 300 * low ? [1] : [1, 2, 5];
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++)
      for (const m of mantissas) if (m * 10 ** e >= low && m * 10 ** e <= high) found.push(m * 10 ** e);
    return found;
  };
  // the loads themselves, where there is room for their labels
  const loads = (u, n, low, high) => {
    let last = -Infinity;
    return chart.x.values.filter(v => {
      const place = u.bbox.width / devicePixelRatio * Math.log(v / low) / Math.log(high / low), free = v >= low && v <= high && place - last > 34;
      if (free) last = place;
      return free;
    });
  };
  const font = "12px system-ui, sans-serif";
  const axis = (label, space, splits) => ({ label, space, size: 52, labelSize: 22, font, labelFont: font, ...(splits ? { splits, filter: (u, all) => all } : {}), stroke: "#1b1f23", grid: { stroke: "#e4e7ea", width: 1 },
    ticks: { stroke: "#b0b6bc", width: 1 }, values: (u, splits) => splits.map(number) });
  const drawing = (u, draw) => {
    const pen = u.ctx, { left, top, width, height } = u.bbox;
    pen.save(); pen.beginPath(); pen.rect(left, top, width, height); pen.clip(); draw(pen); pen.restore();
  };
  const bands = u => drawing(u, pen => chart.series.forEach((s, n) => {
    if (!s.low || !u.series[n + 1].show) return;
    const at = (v, scale) => u.valToPos(v, scale, true), [bottom, top] = chart.y.range;
    const known = s.low.map((low, i) => i).filter(i => s.low[i] != null && s.high[i] != null);
    const points = [...known.map(i => [i, Math.min(s.high[i], top)]), ...known.reverse().map(i => [i, Math.max(s.low[i], bottom)])];
    pen.beginPath(); points.forEach(([i, v]) => pen.lineTo(at(chart.x.values[i], "x"), at(v, "y")));
    pen.fillStyle = pen.strokeStyle = s.colour; pen.globalAlpha = 0.14; pen.fill(); if (known.length === 1) { pen.lineWidth = 6; pen.stroke(); }
  }));
  // the name of each limit stands on its line, further to the left where another name is near
  const limits = u => drawing(u, pen => {
    const scale = devicePixelRatio, { left, width } = u.bbox, drawn = [];
    pen.font = `${11 * scale}px system-ui, sans-serif`; pen.textAlign = "right"; pen.textBaseline = "middle";
    for (const [name, limit] of Object.entries(chart.limits)) {
      const y = u.valToPos(limit, "y", true), room = pen.measureText(name).width + 8 * scale;
      let x = left + width - 4 * scale;
      for (const other of drawn) if (Math.abs(other.y - y) < 12 * scale) x = Math.min(x, other.x - other.room);
      drawn.push({ x, y, room });
      pen.strokeStyle = "#666666"; pen.lineWidth = scale; pen.setLineDash([6 * scale, 4 * scale]);
      pen.beginPath(); pen.moveTo(left, y); pen.lineTo(left + width, y); pen.stroke();
    }
    Object.keys(chart.limits).forEach((name, n) => {
      const { x, y, room } = drawn[n];
      pen.fillStyle = "white"; pen.fillRect(x - room + 4 * scale, y - 7 * scale, room, 14 * scale); pen.fillStyle = "#56606a"; pen.fillText(name, x, y);
    });
  });
  const plot = new uPlot({
    ...size(), hooks: { drawAxes: [bands, limits] }, focus: { alpha: 0.35 }, cursor: { drag: { x: true, y: true, uni: 30 }, focus: { prox: 24 } },
    scales: { x: { time: false, distr: chart.x.log ? 3 : 1, range: () => chart.x.range },
      y: { distr: chart.y.log ? 3 : 1, range: () => chart.y.range } },
    axes: [{ ...axis(chart.x.label, 44, chart.x.log && loads), size: 34 }, axis(chart.y.label, 26, chart.y.log && decades)],
    series: [{ label: chart.x.label, value: (u, v) => number(v) }, ...chart.series.map(s => ({
      label: s.label, stroke: s.colour, width: 2, spanGaps: true, points: { show: true, size: 7, fill: s.colour },
      value: (u, v, n, i) => i == null ? "–" : s.texts[i] ?? "–" }))],
  }, [chart.x.values, ...chart.series.map(s => s.values)], place);
  new ResizeObserver(() => { if (figure.clientWidth && figure.clientWidth !== plot.width) plot.setSize(size()); }).observe(figure);
  figure.classList.add("live");
}
