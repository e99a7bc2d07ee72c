// The page of a recorded run and of the live viewer: scene, read-outs, curves, timeline.
"use strict";

const element = (id) => document.getElementById(id);
const CURVES = [["hip", "Hip flexion"], ["knee", "Knee flexion"]];
const ROWS = [
  ["hip", "Hip angle", 1, "°"], ["knee", "Knee angle", 1, "°"],
  ["hip_torque", "Hip motor torque", 1, " N·m"], ["knee_torque", "Knee motor torque", 1, " N·m"],
  ["force", "Ground force", 0, " N"],
];
const WINDOW = 6;      // seconds that the curves show
const LIVE_MEMORY = 8; // seconds that a live page remembers

// With a true minus sign, and without a minus before nothing.
function number(value, digits) {
  const text = value.toFixed(digits);
  return (Number(text) < 0 ? "\u2212" : "") + text.replace("-", "");
}

function tell(text) {
  element("message").textContent = text;
  element("message").hidden = !text;
}

// ---- scene: meshcat's viewer, its camera, its animation -------------------------------------------

const stage = {
  viewer: null,
  view: null,

  open() {
    this.viewer = new MeshCat.Viewer(element("pane"));
    this.viewer.gui.domElement.style.display = "none";
    this.viewer.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const shadow = this.viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.shadow;
    shadow.mapSize.set(2048, 2048);
    shadow.normalBias = 0.01;
    shadow.bias = -0.0005;
    shadow.radius = 3;
    window.addEventListener("resize", () => this.shift());
  },

  look(view) {
    this.view = view;
    // three.js has y up: (x, y, z) of the scene is (x, z, -y) there.
    const [x, y, z] = view.target, [dx, dy, dz] = view.direction;
    const camera = this.viewer.camera, target = new MeshCat.THREE.Vector3(x, z, -y);
    camera.fov = view.field_of_view;
    camera.near = 0.05;
    camera.position.set(dx, dz, -dy).normalize().multiplyScalar(this.distance()).add(target);
    this.viewer.controls.target.copy(target);
    this.shift();
  },

  // Room that the cards leave; on a narrow screen the figure stands below the first card.
  room() {
    const width = window.innerWidth, height = window.innerHeight, narrow = width < 860 && height > 640;
    const bar = height - element("bar").getBoundingClientRect().top;
    const top = narrow ? element("head").getBoundingClientRect().bottom : 0;
    const wide = width > 1000 ? width - 200 : width;
    return { width, height, rise: (bar - top) / 2, wide, high: Math.max(height - bar - top - 8, 150) };
  },

  distance() {
    const room = this.room(), half = Math.tan((Math.PI / 360) * this.view.field_of_view);
    const tall = (this.view.height * room.height) / room.high;
    const broad = (this.view.width * room.height) / room.wide;
    return Math.max(tall, Math.min(broad, 1.6 * tall)) / (2 * half);
  },

  shift() {
    if (!this.view) return;
    const room = this.room();
    this.viewer.camera.setViewOffset(room.width, room.height, 0, room.rise, room.width, room.height);
    this.viewer.set_dirty();
  },

  take(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    for (let at = 0; at < bytes.length;) {
      const length = view.getUint32(at, true);
      this.viewer.handle_command_bytearray(bytes.slice(at + 4, at + 4 + length));
      at += 4 + length;
    }
    this.viewer.animator.pause();
  },

  seek(time) { this.viewer.animator.seek(time); },
};

// ---- read-outs --------------------------------------------------------------------------------------

const head = {
  cells: [],

  build(page) {
    element("title").textContent = page.title;
    element("subtitle").textContent = page.subtitle;
    element("notes").textContent = page.notes.join(" ");
    document.title = page.title;
    const table = element("read");
    table.replaceChildren();
    this.cells = page.legs.map(() => ({}));
    if (!page.legs.length) return;
    const top = table.createTHead().insertRow();
    top.append(document.createElement("th"));
    for (const leg of page.legs) {
      const cell = document.createElement("th");
      cell.textContent = leg.label;
      cell.style.borderColor = leg.colour;
      top.append(cell);
    }
    const body = table.createTBody();
    const rows = [["phase", "Phase"], ...ROWS].filter(([key]) => page.legs.some((leg) => leg.shows.includes(key)));
    for (const [key, label] of rows) {
      const row = body.insertRow(), name = document.createElement("th");
      name.textContent = label;
      row.append(name);
      page.legs.forEach((leg, index) => { this.cells[index][key] = row.insertCell(); });
    }
  },

  show(page, sample) {
    element("clock").textContent = `${sample.time.toFixed(2)} s` +
      (page.duration === null ? "" : ` of ${page.duration.toFixed(2)} s`);
    sample.legs.forEach((leg, index) => {
      for (const [key, , digits, unit] of ROWS) {
        const cell = this.cells[index][key];
        if (cell) cell.textContent = Number.isFinite(leg[key]) ? number(leg[key], digits) + unit : "–";
      }
      if (this.cells[index].phase) this.pill(this.cells[index].phase, page.phases[leg.phase]);
    });
  },

  pill(cell, phase) {
    if (cell.dataset.phase === phase?.name) return;
    cell.dataset.phase = phase ? phase.name : "";
    const pill = document.createElement("span");
    pill.className = "pill";
    pill.textContent = phase ? phase.label : "–";
    if (phase) { pill.style.background = phase.colour; pill.style.color = phase.ink; }
    cell.replaceChildren(pill);
  },
};

// ---- curves -----------------------------------------------------------------------------------------

function canvas_context(canvas, width, height) {
  const scale = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

const curves = {
  ranges: {},

  // A range that holds every leg, in steps of 20 degrees.
  fit(page) {
    for (const [key] of CURVES) {
      let low = -10, high = 30;
      for (const leg of page.legs) {
        for (const value of leg.series[key]) {
          if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
        }
      }
      this.ranges[key] = [20 * Math.floor(low / 20), 20 * Math.ceil(high / 20)];
    }
  },

  draw(page, time) {
    const width = 296, height = 236, panel = (height - 22) / CURVES.length;
    const context = canvas_context(element("curves"), width, height);
    const last = page.duration === null ? time : page.duration;
    let from = Math.max(0, Math.min(time - WINDOW / 2, last - WINDOW));
    if (page.duration === null) from = Math.max(0, time - WINDOW);
    const to = from + Math.min(WINDOW, page.duration === null ? WINDOW : Math.max(page.duration, 1e-3));
    const x = (t) => 36 + ((width - 44) * (t - from)) / (to - from);
    CURVES.forEach(([key, label], index) => {
      const top = 18 + index * panel, bottom = top + panel - 26, [low, high] = this.ranges[key];
      const y = (v) => bottom - ((bottom - top) * (v - low)) / (high - low);
      this.axes(context, label, top, x, y, low, high, index === CURVES.length - 1, from, to, width);
      context.save();
      context.beginPath();
      context.rect(36, top - 3, width - 44, bottom - top + 6);
      context.clip();
      for (const leg of page.legs) this.line(context, page.times, leg.series[key], leg.colour, x, y, from, to);
      context.restore();
      context.strokeStyle = "#1b2430";
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(x(time), top - 3);
      context.lineTo(x(time), bottom + 3);
      context.stroke();
    });
  },

  axes(context, label, top, x, y, low, high, lowest, from, to, width) {
    context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    context.fillStyle = "#1b2430";
    context.textAlign = "left";
    context.fillText(label, 36, top - 7);
    context.fillStyle = "#5a6776";
    context.strokeStyle = "#d5dbe2";
    context.lineWidth = 1;
    context.textAlign = "right";
    const step = high - low > 90 ? 40 : 20;
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      context.beginPath();
      context.moveTo(36, y(value));
      context.lineTo(width - 8, y(value));
      context.stroke();
      context.fillText(`${number(value, 0)}°`, 32, y(value) + 4);
    }
    if (!lowest) return;
    context.textAlign = "center";
    const spacing = to - from > 3 ? 1 : to - from > 1 ? 0.5 : 0.1;
    for (let k = Math.ceil(from / spacing - 1e-9); k * spacing <= to + 1e-9; k += 1) {
      const text = spacing < 1 ? (k * spacing).toFixed(1) : String(k);
      if (x(k * spacing) < width - 12) context.fillText(text, x(k * spacing), y(low) + 15);
    }
    context.textAlign = "right";
    context.fillText("s", width - 4, y(low) + 15);
  },

  line(context, times, values, colour, x, y, from, to) {
    context.strokeStyle = colour;
    context.lineWidth = 1.8;
    context.beginPath();
    let drawing = false;
    for (let i = 0; i < times.length; i += 1) {
      if (times[i] < from - 0.2 || times[i] > to + 0.2 || !Number.isFinite(values[i])) { drawing = false; continue; }
      if (drawing) context.lineTo(x(times[i]), y(values[i]));
      else context.moveTo(x(times[i]), y(values[i]));
      drawing = true;
    }
    context.stroke();
  },
};

// ---- timeline ---------------------------------------------------------------------------------------

const timeline = {
  build(page) {
    const bands = element("bands");
    bands.replaceChildren();
    for (const leg of page.legs.filter((one) => one.phases)) {
      const name = document.createElement("span"), canvas = document.createElement("canvas");
      name.textContent = leg.label[0];
      name.title = leg.label;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Phases of the ${leg.label.toLowerCase()} leg`);
      bands.append(name, canvas);
    }
    element("legend").replaceChildren(...page.phases.map((phase) => {
      const item = document.createElement("span"), chip = document.createElement("i");
      chip.style.background = phase.colour;
      item.append(chip, phase.label);
      return item;
    }));
    if (page.arrow) {
      const item = document.createElement("span"), chip = document.createElement("i");
      chip.style.background = page.arrow.colour;
      chip.className = "arrow";
      item.append(chip, page.arrow.label);
      element("legend").append(item);
    }
    const end = document.createElement("span");
    end.className = "end";
    end.textContent = page.footnote;
    element("legend").append(end);
    element("time").max = String(page.duration ?? 0);
    this.draw(page);
  },

  draw(page) {
    const legs = page.legs.filter((one) => one.phases), canvases = element("bands").querySelectorAll("canvas");
    legs.forEach((leg, index) => {
      const width = Math.max(canvases[index].clientWidth, 1);
      const context = canvas_context(canvases[index], width, 14);
      const { starts, codes } = leg.phases, total = Math.max(page.duration, 1e-9);
      starts.forEach((start, spell) => {
        const end = spell + 1 < starts.length ? starts[spell + 1] : page.duration;
        context.fillStyle = page.phases[codes[spell]].colour;
        context.fillRect((width * start) / total, 0, (width * (end - start)) / total + 0.5, 14);
      });
    });
    // The slider covers the bands and nothing else; its thumb is 12 px wide.
    const left = canvases.length ? canvases[0].offsetLeft : 0;
    element("time").style.left = `${left - 6}px`;
    element("time").style.width = `calc(100% - ${left}px + 12px)`;
  },

  show(time) { element("time").value = String(time); },
};

// ---- a recorded run ---------------------------------------------------------------------------------

const player = {
  page: null, time: 0, playing: false, last: null,

  async open(page) {
    this.page = page;
    page.times = page.times.map((t) => t / 1000);
    head.build(page);
    timeline.build(page);
    curves.fit(page);
    stage.open();
    stage.take(await inflate(element("scene-data").textContent));
    this.controls();
    const start = this.addressed();
    this.show(start ?? 0);
    stage.look(page.view);
    const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (start === null && !calm) this.play();
    requestAnimationFrame((now) => this.tick(now));
  },

  addressed() {
    const text = new URLSearchParams(location.hash.slice(1)).get("t");
    const time = text === null || text === "" ? NaN : Number(text);
    return Number.isFinite(time) ? time : null;
  },

  controls() {
    element("play").onclick = () => this.toggle();
    element("view").onclick = () => stage.look(this.page.view);
    element("time").oninput = () => { this.pause(); this.show(Number(element("time").value)); this.address(); };
    window.addEventListener("hashchange", () => {
      const time = this.addressed();
      if (time !== null) { this.pause(); this.show(time); }
    });
    window.addEventListener("resize", () => timeline.draw(this.page));
    window.addEventListener("keydown", (event) => this.key(event));
  },

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    if (event.code === "Space" && event.target.tagName === "BUTTON") return; // the button does it
    const step = event.shiftKey ? 0.5 : 1 / this.page.frames_per_second;
    const jumps = { ArrowLeft: this.time - step, ArrowRight: this.time + step, Home: 0, End: this.page.duration };
    if (event.code === "Space") this.toggle();
    else if (event.key in jumps) { this.pause(); this.show(jumps[event.key]); this.address(); }
    else return;
    event.preventDefault();
  },

  toggle() { if (this.playing) { this.pause(); this.address(); } else this.play(); },

  play() {
    if (this.time >= this.page.duration) this.time = 0;
    this.playing = true;
    this.last = null;
    element("play").textContent = "Pause";
  },

  pause() {
    this.playing = false;
    element("play").textContent = "Play";
  },

  // Some browsers refuse to change the address of a local file; the page works without.
  address() {
    try { history.replaceState(null, "", `#t=${this.time.toFixed(2)}`); } catch { /* as said above */ }
  },

  tick(now) {
    requestAnimationFrame((next) => this.tick(next));
    if (!this.playing) return;
    const passed = this.last === null ? 0 : Math.min((now - this.last) / 1000, 0.5);
    this.last = now;
    const time = this.time + passed * Number(element("speed").value);
    this.show(time > this.page.duration ? 0 : time);
  },

  show(time) {
    this.time = Math.min(Math.max(time, 0), this.page.duration);
    stage.seek(this.time);
    head.show(this.page, this.sample(this.time));
    curves.draw(this.page, this.time);
    timeline.show(this.time);
  },

  sample(time) {
    const times = this.page.times;
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time + 1e-9) low = middle; else high = middle - 1;
    }
    const legs = this.page.legs.map((leg) => {
      const values = { phase: leg.phases ? spell(leg.phases, time) : -1 };
      for (const [key] of ROWS) values[key] = leg.series[key] ? leg.series[key][low] : NaN;
      return values;
    });
    return { time, legs };
  },
};

function spell(phases, time) {
  let code = phases.codes[0];
  for (let i = 0; i < phases.starts.length && phases.starts[i] <= time + 1e-9; i += 1) code = phases.codes[i];
  return code;
}

async function inflate(text) {
  const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// ---- the live viewer --------------------------------------------------------------------------------

const live = {
  page: null,

  open() {
    stage.open();
    const inner = stage.viewer.handle_command.bind(stage.viewer);
    stage.viewer.handle_command = (command) => {
      if (command.type === "page") this.start(command.page);
      else if (command.type === "sample") this.show(command.sample);
      else inner(command);
    };
    element("view").onclick = () => { if (this.page) stage.look(this.page.view); };
    stage.viewer.connect(`ws://${location.host}/socket`);
    stage.viewer.connection.addEventListener("close", () => tell("The viewer has ended."));
  },

  start(page) {
    this.page = page;
    document.body.classList.toggle("still", !page.legs.length);
    page.times = [];
    for (const leg of page.legs) leg.series = Object.fromEntries(CURVES.map(([key]) => [key, []]));
    head.build(page);
    timeline.build({ ...page, legs: [] });
    stage.look(page.view);
  },

  show(sample) {
    if (!this.page || !this.page.legs.length) return;
    const { page } = this;
    if (page.times.length && sample.time < page.times[page.times.length - 1]) this.forget(page.times.length);
    page.times.push(sample.time);
    sample.legs.forEach((leg, index) => { for (const [key] of CURVES) page.legs[index].series[key].push(leg[key]); });
    this.forget(page.times.findIndex((time) => time >= sample.time - LIVE_MEMORY));
    head.show(page, sample);
    curves.fit(page);
    curves.draw(page, sample.time);
  },

  forget(count) {
    this.page.times.splice(0, count);
    for (const leg of this.page.legs) for (const [key] of CURVES) leg.series[key].splice(0, count);
  },
};

// `ready` is what a test or another page can wait for.
window.ready = (async () => {
  const page = JSON.parse(element("page-data").textContent);
  document.body.className = page.mode;
  try {
    if (page.mode === "live") live.open(); else await player.open(page);
  } catch (error) {
    tell(`This page needs a browser with WebGL that is not older than 2023 (${error.message}).`);
    throw error;
  }
})();
