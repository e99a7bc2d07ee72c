// The page of a recorded run, of two runs next to each other, and of the live viewer. There is no build step:
// these files are concatenated to one script.
//
//   basics.js    texts, colours, canvases          plots.js     curves, all on one span of time
//   stage.js     a scene and its camera            timeline.js  bands of phases, slider, legend
//   readout.js   the card with the numbers         player.js    recorded runs: clock, keys, address
//   live.js      data of a running simulation      joints.js    a model and its sliders
//   start.js     start of the page
//
// Data of the page (element page-data, JSON):
//   {mode: "recorded", runs: [RUN, ...]}, {mode: "live"} or {mode: "model", runs: [RUN]}
// RUN, and DESCRIPTION of a live scene:
//   {title, subtitle: [text], differing: [text], notes: [text], view: {target, direction, width, height, field_of_view},
//    phases: [{name, label, short, colour, ink}], modes: [label], legs: [{side, label, colour, dark, shows: [key]}],
//    parts: [{key, label, colour}], labels: {KIND: {name, unit}} of the kinds angle, torque, force and crutch,
//    arrow: {label, colour} or null,
//    arcs: [{label, colour}], floor: path, duration: s or null, footnote,
//    strides: {side, starts: [s]} or null, events: [{kind: fault, trip, fall or divergence, time: s, text}], outcome: word,
//    walk: [[label, left, right, healthy]], a header and rows of texts, or nothing}
// A recorded RUN also holds `frames` and `scene`, deflated, as base64 text: JSON of
//   {times: [ms], legs: [{series: {key: {steps: [ms], values: [value]}}, phases: SPELLS or null}],
//    modes: SPELLS or null}, SPELLS being {starts: [s], codes: [n]}
// where `times` are the times of the frames, and a series has points at the frames and between them (`steps` from
// point to point), and the commands of meshcat's viewer, each after its length in four bytes, little-endian.
// The RUN of a model holds `scene` and `joints`.
//
// Live messages are binary: one command of meshcat's viewer in msgpack, or several commands, each after its
// length as above. There are two types in addition to meshcat's:
//   {type: "page", path: "", page: DESCRIPTION}      new content of the page; clears the curves
//   {type: "sample", path: "", sample: SAMPLE}       values at one time
// SAMPLE: {time: s, legs: [{phase: code, KEY: value, ...}], curves: [{KEY: {times: [s], values: [value]}, ...}],
// events: all events of the run so far, mode: code}, with the legs in the order of the description; curves contain all points
// since the last sample.
// Keys of values, JOINT being hip, knee or ankle: JOINT [deg]; JOINT_torque [N·m]; JOINT_ before impedance,
// friction_compensation, gravity_compensation, inertia_compensation, target [N·m]; force, crutch [N].
// A key that is not in `shows` is not displayed; a key that is not sent is displayed as a dash.
//
// Interface for another script: window.twinGait = {show(sample), receive(bytes), page(), stage, plots, theme,
// show_message, ready}; see start.js.
"use strict";

const element = (id) => document.getElementById(id);
// Joints of a leg, with the name of the positive direction; a page shows the driven joints of its legs.
const JOINTS = [["hip", "Hip", "flexion"], ["knee", "Knee", "flexion"], ["ankle", "Ankle", "dorsiflexion"]];

function make(tag, name = "", text = "") {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (text) made.textContent = text;
  return made;
}

const capitalize = (text) => text.replace(/^./, (letter) => letter.toUpperCase());

// Format a number with a typographic minus sign, and without a sign before zero.
function number(value, digits) {
  const text = value.toFixed(digits);
  return (Number(text) < 0 ? "\u2212" : "") + text.replace("-", "");
}

function show_message(text) {
  element("message").textContent = text;
  element("message").hidden = !text;
}

// Return the index of the last of sorted numbers that is not larger than a value, at least 0.
function last_before(sorted, value) {
  let low = 0, high = sorted.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (sorted[middle] <= value + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

// Interpolate a series {times, values} at a time.
function value_at({ times, values }, time) {
  const low = last_before(times, time), high = Math.min(low + 1, times.length - 1);
  if (times[high] <= times[low] || time <= times[low] + 1e-9) return values[low];
  return values[low] + ((values[high] - values[low]) * (time - times[low])) / (times[high] - times[low]);
}

// Map a time from one list of times to another by linear interpolation and extrapolation.
function map_time(from, to, time) {
  const last = Math.min(from.length, to.length) - 1, k = Math.min(last_before(from, time), last - 1);
  return to[k] + ((to[k + 1] - to[k]) * (time - from[k])) / (from[k + 1] - from[k]);
}

// ---- light and dark ---------------------------------------------------------------------------------

const theme = {
  listeners: [],
  inks: {},

  get dark() { return document.documentElement.dataset.theme === "dark"; },

  open(requested) {
    const system = window.matchMedia("(prefers-color-scheme: dark)");
    this.set(requested ? requested === "dark" : system.matches);
    system.addEventListener("change", () => this.set(system.matches));
    element("theme").onclick = () => this.set(!this.dark);
  },

  set(dark) {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "soft", "line", "sheet", "alarm"]) this.inks[name] = style.getPropertyValue(`--${name}`).trim();
    for (const listener of this.listeners) listener();
  },

  // Return the colour of a leg that contrasts with the background.
  of(leg) { return this.dark ? leg.dark : leg.colour; },
};

// ---- drawing ----------------------------------------------------------------------------------------

function canvas_context(canvas, width, height) {
  const scale = Math.max(window.devicePixelRatio || 1, document.body.classList.contains("printing") ? 3 : 1);
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

const FONT = "system-ui, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";

// Draw a band of phases; colour, hatching and letters each identify the phase.
function draw_band(context, page, spells, box, from, to, end) {
  const { starts, codes } = spells, scale = box.width / Math.max(to - from, 1e-9);
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.width, box.height);
  context.clip();
  context.font = `650 10px ${FONT}`;
  context.textAlign = "center";
  starts.forEach((start, index) => {
    const stop = index + 1 < starts.length ? starts[index + 1] : end;
    if (stop < from || start > to) return;
    const left = box.left + scale * (start - from), width = scale * (stop - start);
    const phase = page.phases[codes[index]];
    draw_phase(context, phase, codes[index], left, box.top, width, box.height);
    const shown = Math.min(left + width, box.left + box.width) - Math.max(left, box.left);
    if (shown < 17) return;
    context.fillStyle = phase.ink;
    const text = shown > context.measureText(phase.label).width + 10 ? phase.label : phase.short;
    context.fillText(text, Math.max(left, box.left) + shown / 2, box.top + box.height / 2 + 3.6);
  });
  context.restore();
}

// Draw the events of a run [{kind, time, text}] as lines across a box; x maps a time to a position.
function draw_events(context, events, x, box, named = false) {
  let free = -Infinity;
  context.strokeStyle = context.fillStyle = theme.inks.alarm;
  context.font = `650 10px ${FONT}`;
  context.textAlign = "left";
  for (const { kind, time } of events) {
    const at = Math.min(Math.max(x(time), box.left + 1), box.right - 1);
    if (x(time) < box.left - 1 || x(time) > box.right + 1) continue;
    context.lineWidth = 2;
    context.setLineDash(kind === "fault" ? [3, 2] : []);
    context.beginPath();
    context.moveTo(at, box.top);
    context.lineTo(at, box.bottom);
    context.stroke();
    context.setLineDash([]);
    if (!named) continue;
    // The names of events that are close together are written below each other.
    const width = context.measureText(kind).width + 4, row = at < free ? 1 : 0, left = at + 3 + width > box.right;
    context.fillText(kind, left ? at - width : at + 3, box.top + 9 + 11 * row);
    free = at + 3 + width;
  }
}

const HATCHES = [[], [[3, 3, 3, 3]], [[0, 3, 6, 3]], [[0, 6, 6, 0]], [[0, 0, 6, 6]]];

function draw_phase(context, phase, code, left, top, width, height) {
  context.fillStyle = phase.colour;
  context.fillRect(left, top, width, height);
  const lines = HATCHES[code % HATCHES.length];
  if (!lines.length) return;
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.globalAlpha = 0.3;
  context.strokeStyle = phase.ink;
  context.lineWidth = 1;
  context.lineCap = "round";
  context.beginPath();
  for (let x = Math.floor(left / 6) * 6; x < left + width; x += 6) {
    for (let y = top; y < top + height; y += 6) {
      for (const [a, b, c, d] of lines) { context.moveTo(x + a, y + b); context.lineTo(x + c + 0.01, y + d); }
    }
  }
  context.stroke();
  context.restore();
}
