/* Curves of the page that can be hovered and zoomed; without scripts and on paper their pictures stand there. */
for (const figure of document.querySelectorAll("figure.chart")) {
  const chart = JSON.parse(figure.querySelector("script").textContent);
  const place = figure.insertBefore(document.createElement("div"), figure.firstChild);
  const number = v => v == null ? "" : v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5) ? v.toExponential(0) : String(+v.toPrecision(6));
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
  const bars = u => chart.series.forEach((s, n) => {
    if (!s.low || !u.series[n + 1].show) return;
    const at = (v, scale) => u.valToPos(v, scale, true), pen = u.ctx, { left, top, width, height } = u.bbox;
    pen.save(); pen.beginPath(); pen.rect(left, top, width, height); pen.clip(); pen.beginPath();
    pen.strokeStyle = s.colour; pen.lineWidth = devicePixelRatio; pen.globalAlpha = 0.7;
    s.low.forEach((low, i) => {
      if (low == null || s.high[i] == null) return;
      const x = at(chart.x.values[i], "x");
      pen.moveTo(x, at(Math.max(low, chart.y.range[0]), "y")); pen.lineTo(x, at(Math.min(s.high[i], chart.y.range[1]), "y"));
    });
    pen.stroke(); pen.restore();
  });
  const plot = new uPlot({
    ...size(), hooks: { draw: [bars] }, focus: { alpha: 0.35 }, cursor: { drag: { x: true, y: true, uni: 30 }, focus: { prox: 24 } },
    scales: { x: { time: false, distr: chart.x.log ? 3 : 1, range: () => chart.x.range },
      y: { distr: chart.y.log ? 3 : 1, range: () => chart.y.range } },
    axes: [{ ...axis(chart.x.label, 44, chart.x.log && loads), size: 34 }, axis(chart.y.label, 26, chart.y.log && decades)],
    series: [{ label: chart.x.label, value: (u, v) => number(v) }, ...chart.series.map(s => ({
      label: s.label, stroke: s.colour, width: s.points ? 2 : 1, dash: s.dash, spanGaps: true, points: { show: s.points, size: 7, fill: s.colour },
      value: (u, v, n, i) => i == null ? "–" : s.texts[i] ?? "–" }))],
  }, [chart.x.values, ...chart.series.map(s => s.values)], place);
  new ResizeObserver(() => { if (figure.clientWidth && figure.clientWidth !== plot.width) plot.setSize(size()); }).observe(figure);
  figure.classList.add("live");
}
