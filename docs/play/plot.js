"use strict";
/* Line plots on a canvas: sharp on any screen, in the colours of the page's style sheet. */
const Plot = (() => {
  const MARGIN = { left: 64, right: 12, top: 10, bottom: 42 };
  let palette = null;

  /* A colour of the style sheet; read once, and again after forgetColours(). */
  function colour(name) {
    if (!palette) palette = {};
    if (!palette[name]) palette[name] = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    return palette[name];
  }

  function forgetColours() {
    palette = null;
  }

  /* A step of 1, 2 or 5 times a power of ten that cuts `span` into at most `most` parts. */
  function niceStep(span, most) {
    const power = 10 ** Math.floor(Math.log10(span / most));
    const over = span / most / power;
    return power * (over <= 1 ? 1 : over <= 2 ? 2 : over <= 5 ? 5 : 10);
  }

  /* Limits on round numbers around low and high, so that axes stand still while their curves move a little. */
  function roundLimits(low, high, parts = 5) {
    const step = niceStep(Math.max(high - low, 1e-12), parts);
    return [Math.floor(low / step + 1e-9) * step, Math.ceil(high / step - 1e-9) * step];
  }

  /* Start a plot: clears the canvas, draws the axes, and returns what draws in data coordinates. */
  function begin(canvas, { x, y, xLabel, yLabel }) {
    const density = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) {
      canvas.width = Math.round(width * density);
      canvas.height = Math.round(height * density);
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, width, height);
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    const atX = (value) => MARGIN.left + ((value - x[0]) / (x[1] - x[0])) * (right - MARGIN.left);
    const atY = (value) => bottom - ((value - y[0]) / (y[1] - y[0])) * (bottom - MARGIN.top);
    axes(pen, { x, y, xLabel, yLabel, right, bottom, atX, atY });
    pen.save();
    pen.beginPath();
    pen.rect(MARGIN.left, MARGIN.top, right - MARGIN.left, bottom - MARGIN.top);
    pen.clip();
    return { pen, atX, atY };
  }

  function axes(pen, { x, y, xLabel, yLabel, right, bottom, atX, atY }) {
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.strokeStyle = colour("grid");
    pen.fillStyle = colour("quiet");
    pen.textBaseline = "top";
    pen.textAlign = "center";
    for (const value of ticks(x, Math.max(2, Math.floor((right - MARGIN.left) / 70)))) {
      line(pen, atX(value), MARGIN.top, atX(value), bottom);
      pen.fillText(written(value, x), atX(value), bottom + 5);
    }
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const value of ticks(y, Math.max(2, Math.floor((bottom - MARGIN.top) / 36)))) {
      line(pen, MARGIN.left, atY(value), right, atY(value));
      pen.fillText(written(value, y), MARGIN.left - 6, atY(value));
    }
    pen.strokeStyle = colour("line");
    pen.strokeRect(MARGIN.left, MARGIN.top, right - MARGIN.left, bottom - MARGIN.top);
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    pen.fillText(xLabel, (MARGIN.left + right) / 2, bottom + MARGIN.bottom - 4);
    pen.save();
    pen.translate(4, (MARGIN.top + bottom) / 2);
    pen.rotate(-Math.PI / 2);
    pen.textBaseline = "top";
    pen.fillText(yLabel, 0, 0);
    pen.restore();
  }

  function line(pen, x0, y0, x1, y1) {
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.lineTo(x1, y1);
    pen.stroke();
  }

  function ticks([low, high], most) {
    const step = niceStep(high - low, most), values = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) values.push(i * step);
    return values;
  }

  /* A tick with as many digits as its axis needs, and a true minus. */
  function written(value, [low, high]) {
    const digits = Math.max(0, 1 - Math.floor(Math.log10((high - low) / 2)));
    const text = String(Number(value.toFixed(digits + 1)));
    return text === "-0" ? "0" : text.replace("-", "\u2212");
  }

  /* A curve through (xs, ys). */
  function curve({ pen, atX, atY }, xs, ys, stroke, width = 1.6) {
    pen.beginPath();
    for (let i = 0; i < xs.length; i++) pen.lineTo(atX(xs[i]), atY(ys[i]));
    pen.strokeStyle = stroke;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.stroke();
  }

  function area({ pen, atX, atY }, points, fill) {
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(atX(x), atY(y));
    pen.closePath();
    pen.fillStyle = fill;
    pen.fill();
  }

  function dot({ pen, atX, atY }, x, y, radius, fill, edge) {
    pen.beginPath();
    pen.arc(atX(x), atY(y), radius, 0, 2 * Math.PI);
    pen.fillStyle = fill;
    pen.fill();
    if (edge) {
      pen.strokeStyle = edge;
      pen.lineWidth = 2;
      pen.stroke();
    }
  }

  const end = ({ pen }) => pen.restore();

  return { begin, end, curve, area, dot, colour, forgetColours, roundLimits };
})();
