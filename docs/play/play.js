"use strict";
/* The page: sliders to engine.js to canvases, and the mechanisms computed beforehand. */

const element = (id) => document.getElementById(id);
const SLIDERS = {
  frequency: { unit: "Hz", step: 0.1, digits: 1, start: 120 },
  amplitude: { unit: "V", step: 0.005, digits: 3, start: 0.45 },
  pressure: { unit: "bar", step: 0.01, digits: 2, start: 1.0 },
};
const BUDGET = 8; // ms of each frame for running the rig
const PATIENCE = 8000; // excitation periods after which what does not repeat is called so
const NEAR = 1e-2; // a return this close, in the indenter's own amplitude, names the motion that is coming
const FEWEST_SHOWN = 4, MOST_SHOWN = 12, PER_PERIOD = 160;
const QUIET = 500; // ms without a change after which the motion is spoken

const MINUS = "\u2212";
const signed = (text) => text.replace("-", MINUS);

/* A number as people write it: 10000000000 as 1e10. */
function short(value) {
  const size = Math.abs(value);
  const text = size >= 1e5 || (size > 0 && size < 1e-3) ? value.toExponential().replace("e+", "e") : String(value);
  return text.replaceAll("-", MINUS);
}

/* Radio buttons named `name` for [value, text or nodes, name for readers]; `chosen` is called with the value picked. */
function radios(place, name, choices, checked, chosen) {
  for (const [value, text, spoken] of choices) {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: "radio", name, value, checked: String(value) === String(checked) });
    if (spoken) input.setAttribute("aria-label", spoken);
    input.addEventListener("change", () => chosen(value));
    label.append(input, ...[text].flat());
    place.append(label);
  }
}

/* Text on a line of its own. */
function ownLine(text) {
  const span = document.createElement("span");
  span.className = "line";
  span.textContent = text;
  return span;
}

// --- Motions

const setting = {};
let rock = "4";
let orbit = null;
let kind = null; // of a motion without period, once told: "chaotic" or "aperiodic"
let scheduled = false;
let spoken = 0;

const model = () => Engine.makeModel(CONSTANTS.rig, CONSTANTS.rocks[rock], setting);

function schedule() {
  if (!scheduled) {
    scheduled = true;
    requestAnimationFrame(frame);
  }
}

function changed() {
  kind = null;
  orbit.change(model());
  element("label").classList.add("coming");
  clearTimeout(spoken);
  spoken = setTimeout(speak, QUIET);
  schedule();
}

/* One frame: run the rig for a while, draw it, and come back where it has not settled. */
function frame() {
  scheduled = false;
  if (element("motions").hidden) return;
  const until = performance.now() + BUDGET;
  while (!orbit.period && orbit.periods < PATIENCE && performance.now() < until) orbit.run(32);
  if (!orbit.period && orbit.periods >= PATIENCE && !kind) kind = orbit.exponent(1000) > 0 ? "chaotic" : "aperiodic";
  draw();
  if (!orbit.period && !kind) schedule();
}

function draw() {
  const coming = orbit.period || kind ? 0 : orbit.closes(NEAR);
  const period = orbit.period || coming;
  const shown = period ? Math.min(MOST_SHOWN, period * Math.ceil(FEWEST_SHOWN / period)) : MOST_SHOWN;
  const run = Engine.follow(orbit.model, orbit.state, Math.max(shown, period || 32), PER_PERIOD);
  const laps = period ? Math.max(shown, period) / period : 1;
  const name = period ? `P-${period}-I-${Math.round(run.impacts / laps)}` : kind || "settling";
  readout(run, name);
  drawPortrait(run);
  drawForce(run, shown);
  drawMap(name === "P-1-I-1" && orbit.period === 1);
  describe(run, name);
}

function readout(run, name) {
  const label = element("label");
  label.textContent = name;
  label.classList.toggle("coming", !orbit.period && !kind);
  element("rate").textContent = `${signed((1e3 * run.rate).toFixed(3))} mm/s`;
  element("peak").textContent = `${run.peakForce.toFixed(0)} N`;
  element("speed").textContent = `${(1e3 * run.peakSpeed).toFixed(1)} mm/s`;
  element("state").textContent = orbit.period
    ? `Settled: repeats to nine digits, ${orbit.periods} periods after the last change.`
    : kind
      ? `Has not repeated within ${Engine.LONGEST_PERIOD} periods in ${orbit.periods}; the numbers are those of the last 32.`
      : `Settling: ${orbit.periods} periods run since the last change. What is shown is still on its way.`;
}

const REGIME_COLOURS = ["free", "loading", "unloading"];

function drawPortrait(run) {
  const { place, speed, regime, time } = run.samples;
  const xs = place.map((each) => 1e3 * each), ys = speed.map((each) => 1e3 * each);
  const plot = Plot.begin(element("portrait"), {
    x: Plot.roundLimits(Math.min(...xs), Math.max(...xs)),
    y: Plot.roundLimits(Math.min(...ys), Math.max(...ys)),
    xLabel: "place from the rock's face, X2 \u2212 Xf [mm]",
    yLabel: "speed [mm/s]",
  });
  // a stroke for each stretch in one regime; the next one starts where it ends
  for (let from = 0; from < xs.length - 1; ) {
    let to = from + 1;
    while (to < xs.length - 1 && regime[to] === regime[from]) to++;
    Plot.curve(plot, xs.slice(from, to + 1), ys.slice(from, to + 1), Plot.colour(REGIME_COLOURS[regime[from]]));
    from = to;
  }
  const length = 1 / setting.frequency;
  let next = 0;
  for (let i = 0; i < time.length; i++) {
    if (time[i] < next - 1e-12) continue;
    Plot.dot(plot, xs[i], ys[i], 3.5, Plot.colour("ink"));
    next += length;
  }
  Plot.end(plot);
}

function drawForce(run, shown) {
  const length = 1e3 / setting.frequency, xs = run.samples.time.map((each) => 1e3 * each);
  const plot = Plot.begin(element("force"), {
    x: [0, shown * length],
    y: Plot.roundLimits(0, Math.max(run.peakForce, 100) * 1.02),
    xLabel: "time [ms]",
    yLabel: "force [N]",
  });
  for (let n = 1; n < shown; n++) Plot.curve(plot, [n * length, n * length], [0, 1e6], Plot.colour("line"), 1);
  Plot.curve(plot, xs, run.samples.force, Plot.colour("loading"), 1.8);
  Plot.end(plot);
}

/* The boundary carried on, straight, to the edge of the box at ratio `low`. */
function toEdge(points, low) {
  const [[f0, r0], [f1, r1]] = points;
  return [[f0 - ((r0 - low) * (f1 - f0)) / (r1 - r0), low], ...points];
}

function drawMap(onIt) {
  const { frequency, amplitude, pressure } = CONSTANTS.box;
  const low = pressure[0] / amplitude[0] / 2, high = pressure[1] / amplitude[0];
  const plot = Plot.begin(element("map"), {
    x: [frequency[0] - 2, frequency[1] + 2],
    y: [low - 0.1, high],
    xLabel: "frequency [Hz]",
    yLabel: "pressure / amplitude [bar/V]",
  });
  const { strong, weak, weakEnd } = CONSTANTS.boundary[rock];
  const edge = toEdge(strong, low);
  Plot.area(plot, [...edge, [frequency[1], low]], Plot.colour("region"));
  const last = weakEnd[weakEnd.length - 1];
  Plot.area(plot, [...weak, [frequency[1], high], [last[0], high], ...weakEnd.slice().reverse()], Plot.colour("weak"));
  for (const [other, curves] of Object.entries(CONSTANTS.boundary)) {
    if (other !== rock) line(plot, toEdge(curves.strong, low), Plot.colour("other"), 1);
  }
  line(plot, edge, Plot.colour("free"), 2.2);
  const ratio = setting.pressure / setting.amplitude;
  Plot.dot(plot, setting.frequency, ratio, 6, onIt ? Plot.colour("loading") : Plot.colour("paper"), Plot.colour("loading"));
  Plot.end(plot);
}

function line(plot, points, stroke, width) {
  Plot.curve(plot, points.map(([x]) => x), points.map(([, y]) => y), stroke, width);
}

/* What the canvases show, in words. */
function describe(run, name) {
  const rate = `${(1e3 * run.rate).toFixed(3)} mm/s`, peak = `${run.peakForce.toFixed(0)} N`;
  element("portrait").setAttribute("aria-label", `Phase portrait, ${name}: speed over place from the rock's face`);
  element("force").setAttribute("aria-label", `Contact force over time, ${name}, at most ${peak}`);
  element("map").setAttribute(
    "aria-label",
    `Map: ${setting.frequency} Hz, pressure over amplitude ${(setting.pressure / setting.amplitude).toFixed(2)} bar/V`,
  );
  element("motions").dataset.spoken = `${name}, penetration rate ${rate}, largest force ${peak}`;
}

function speak() {
  element("spoken").textContent = element("motions").dataset.spoken || "";
}

function setUpSliders() {
  for (const [name, { unit, step, digits, start }] of Object.entries(SLIDERS)) {
    const [min, max] = CONSTANTS.box[name], range = element(name), number = element(`${name}-number`);
    for (const input of [range, number]) Object.assign(input, { min, max, step });
    const set = (value) => {
      setting[name] = value;
      range.setAttribute("aria-valuetext", `${value.toFixed(digits)} ${unit}`);
    };
    Object.assign(range, { value: start });
    number.value = start.toFixed(digits);
    set(start);
    range.addEventListener("input", () => {
      set(range.valueAsNumber);
      number.value = range.valueAsNumber.toFixed(digits);
      changed();
    });
    // while one types only what lies in the box is taken; what is left behind goes to the box's edge
    number.addEventListener("input", () => {
      const value = number.valueAsNumber;
      if (!(value >= min && value <= max)) return;
      range.value = value;
      set(value);
      changed();
    });
    number.addEventListener("change", () => {
      const typed = Number.isFinite(number.valueAsNumber) ? number.valueAsNumber : setting[name];
      const value = Math.min(max, Math.max(min, typed));
      number.value = value.toFixed(digits);
      range.value = value;
      set(value);
      changed();
    });
  }
}

function showRock() {
  const { name, kl, ku } = CONSTANTS.rocks[rock];
  const [, sandstone, angle] = /(\d+)-indenter(\d+)/.exec(name);
  const stiffness = (each) => (each / 1e6).toFixed(2);
  element("rock-name").textContent =
    `Sandstone ${sandstone}, indenter of ${angle}\u00b0: ${stiffness(kl)} kN/mm loading, ${stiffness(ku)} kN/mm unloading.`;
}

function setUpMotions() {
  setUpSliders();
  radios(element("rocks"), "rock", Object.keys(CONSTANTS.rocks).map((each) => [each, each, `Rock ${each}`]), rock, (value) => {
    rock = value;
    showRock();
    changed();
  });
  showRock();
  element("rest").addEventListener("click", () => {
    orbit = new Engine.Orbit(model());
    changed();
  });
  orbit = new Engine.Orbit(model());
  changed();
}

// --- A missing mechanism

const seen = { effect: 0, strength: 1, example: 0 };

/* Packed samples as numbers: 16-bit integers, little end first, times what one is worth. */
function unpacked({ digit, data }) {
  const bytes = atob(data), values = new Float64Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) {
    const word = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
    values[i] = digit * (word > 32767 ? word - 65536 : word);
  }
  return values;
}

const extremes = (...signals) => [
  Math.min(...signals.map((each) => Math.min(...each))),
  Math.max(...signals.map((each) => Math.max(...each))),
];

function drawMissing() {
  const effect = MECHANISMS.effects[seen.effect], example = MECHANISMS.examples[seen.example];
  const run = MECHANISMS.runs[seen.effect][seen.example][seen.strength], on = element("on").checked;
  const without = effect.rest ? example.rest : example.settled, xs = [];
  for (let i = 0; i < MECHANISMS.periods * MECHANISMS.samples; i++) {
    xs.push((1e3 * i) / (MECHANISMS.samples * example.frequency));
  }
  const told = [];
  let peak = 0;
  for (const [channel, unit, stroke] of [["force", "N", "loading"], ["acceleration", "m/s\u00b2", "free"]]) {
    const plain = unpacked(without[channel]), changedBy = unpacked(run[channel]);
    const shown = on ? changedBy : plain, residual = shown.map((each, i) => each - plain[i]);
    // the axes are those with the mechanism on, so that switching it on and off moves the curves alone
    const least = 0.005 * Math.max(...plain.map(Math.abs)); // so that no residual is a flat line, not rounding drawn large
    const most = extremes(changedBy.map((each, i) => each - plain[i]), [-least, least]);
    const label = `${channel} [${unit}]`;
    drawSignals(`${channel}-both`, xs, [[plain, "quiet", 1.4], [shown, stroke, 1.8]], extremes(plain, changedBy), label);
    drawSignals(`${channel}-residual`, xs, [[residual, stroke, 1.8]], most, label);
    const share = Math.max(...residual.map(Math.abs)) / Math.max(...plain.map(Math.abs));
    element(`residual-${channel}`).textContent = `${(100 * share).toPrecision(3)} %`;
    element(`${channel}-both`).setAttribute("aria-label", `${channel} over three periods, with and without ${effect.name}`);
    element(`${channel}-residual`).setAttribute("aria-label", `residual of the ${channel}, at most ${(100 * share).toPrecision(3)} %`);
    told.push(`residual of the ${channel} ${(100 * share).toPrecision(3)} % of its largest value`);
    if (channel === "force") peak = Math.max(...shown);
  }
  element("motion-with").textContent = on ? run.motion : example.motion;
  element("peak-with").textContent = `${peak.toFixed(0)} N`;
  element("spoken-missing").textContent = `${on ? effect.name : "no mechanism"}: ${told.join(", ")}`;
  describeMechanism(effect, run, on, example);
}

function drawSignals(id, xs, signals, [low, high], yLabel) {
  const pad = Math.max(0.04 * (high - low), 1e-3);
  const plot = Plot.begin(element(id), {
    x: [0, xs[xs.length - 1] + xs[1]],
    y: Plot.roundLimits(low - pad * (low < 0), high + pad),
    xLabel: "time [ms]",
    yLabel,
  });
  for (const [ys, stroke, width] of signals) Plot.curve(plot, xs, ys, Plot.colour(stroke), width);
  Plot.end(plot);
}

function describeMechanism(effect, run, on, example) {
  const values = effect.parameters.map(({ symbol, meaning, unit }, i) =>
    `${symbol} = ${short(run.values[i])}${unit && unit !== "1" ? ` ${unit}` : ""} (${meaning})`);
  element("sentence").textContent = effect.sentence;
  element("equation").textContent = effect.equation;
  element("values").textContent = values.join("; ");
  const when = effect.rest
    ? "The first three periods from rest on a fresh face; the motion named is the one settled on."
    : "Three periods after the rig has settled.";
  const where = effect.sensor ? " It acts on the sensors: the rig moves as before, what is read differs." : "";
  element("told").textContent =
    `${when}${where} Residuals are shares of the largest value without it.${on ? "" : ` Switched off: the paper's model, ${example.motion}.`}`;
}

function setUpMissing() {
  const groups = [["On the rig", false], ["On the sensors", true]];
  for (const [label, sensor] of groups) {
    const group = document.createElement("optgroup");
    group.label = label;
    MECHANISMS.effects.forEach((effect, i) => {
      if (effect.sensor !== sensor) return;
      const option = document.createElement("option");
      option.value = i;
      option.textContent = effect.name.replaceAll("-", " ");
      group.append(option);
    });
    element("effect").append(group);
  }
  seen.effect = MECHANISMS.effects.findIndex((effect) => effect.name === "contact-rate");
  element("effect").value = seen.effect;
  element("effect").addEventListener("change", (event) => {
    seen.effect = Number(event.target.value);
    drawMissing();
  });
  const choose = (key) => (value) => {
    seen[key] = value;
    drawMissing();
  };
  radios(element("strengths"), "strength", MECHANISMS.strengths.map((each, i) => [i, each]), seen.strength, choose("strength"));
  const examples = MECHANISMS.examples.map((each, i) => [
    i, [`Rock ${each.rock}, ${each.frequency} Hz, ${each.amplitude} V, ${each.pressure} bar`, ownLine(each.motion)],
  ]);
  radios(element("examples"), "example", examples, seen.example, choose("example"));
  element("on").addEventListener("change", drawMissing);
}

// --- Tabs and the window

function setUpTabs() {
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const pick = (tab) => {
    for (const each of tabs) {
      each.setAttribute("aria-selected", each === tab);
      each.tabIndex = each === tab ? 0 : -1;
      element(each.getAttribute("aria-controls")).hidden = each !== tab;
    }
    redraw();
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => pick(tab));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = tabs[(i + step + tabs.length) % tabs.length];
      pick(next);
      next.focus();
    });
  });
  if (location.hash === "#mechanisms") pick(element("tab-missing"));
}

function redraw() {
  Plot.forgetColours();
  if (element("missing").hidden) schedule();
  else drawMissing();
}

setUpMotions();
setUpMissing();
setUpTabs();
window.addEventListener("resize", redraw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
