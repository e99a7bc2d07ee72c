// ---- curves: panels on one span of time -------------------------------------------------------------

const WINDOW = 6;       // default span of the curves in s
const SHORTEST = 0.05;  // smallest span of the curves in s
const MARGIN = { left: 40, right: 8, top: 19, bottom: 7 };
const AXIS = 16, BAND = 14;
const DASHES = { A: [], B: [5, 3] };

const plots = {
  strides: null, // strides of the common clock, if two runs are compared by per cent of a stride
  runs: [], time: 0, end: null, span: null, whole: false, drag: null, panels: [], onseek: null,

  // Open the card for runs [{name, page, times, legs}], whose legs have side, series and phases.
  open(runs, end) {
    this.runs = runs;
    this.end = end;
    this.span = null;
    const sets = this.sets(), choice = element("curve-set"), kept = choice.selectedIndex;
    choice.replaceChildren(...sets.map((set) => make("option", "", set.name)));
    choice.selectedIndex = Math.min(Math.max(kept, 0), sets.length - 1);
    choice.onchange = () => this.choose();
    this.choose();
    this.listen();
  },

  choose() {
    const set = this.sets()[element("curve-set").selectedIndex];
    this.panels = set ? set.panels.flatMap((panel) => this.compared(panel)) : [];
    this.name(set);
    this.fit();
    this.draw();
  },

  // ---- sets of panels

  lines(key, options = {}) {
    return this.runs.flatMap((run) => run.legs.filter((leg) => leg.series[key]).map((leg) => ({
      run, leg, key, series: leg.series[key], dash: DASHES[run.name] || [], colour: () => theme.of(leg), ...options,
    })));
  },

  sets() {
    if (!this.runs.length) return [];
    const { angle, torque, force, crutch } = this.runs[0].page.labels;
    const each = (suffix, unit, label) => JOINTS.map(([joint, name, positive]) => (
      { label: `${name} ${label ?? positive}`, unit, lines: this.lines(joint + suffix) }));
    const sets = [
      { name: "Angles and torques", panels: [...each("", angle.unit), ...each("_torque", torque.unit, torque.name)] },
      ...this.runs[0].legs.map((leg) => this.split(leg)),
      { name: "Ground reaction forces", panels: [
        { label: `${capitalize(force.name)} on the foot`, unit: force.unit, lines: this.lines("force") },
        { label: capitalize(crutch.name), unit: crutch.unit, lines: this.lines("crutch") },
      ] },
    ];
    for (const set of sets) set.panels = set.panels.filter((panel) => panel.lines.length);
    return sets.filter((set) => set.panels.length);
  },

  // Return the panels with the parts of the commanded torque of a leg, and with the motor torque.
  split(leg) {
    const { torque } = this.runs[0].page.labels;
    const panels = JOINTS.map(([joint, name]) => {
      const parts = this.runs[0].page.parts.map((part) => ({ key: `${joint}_${part.key}`, label: part.label, colour: () => part.colour }));
      const lines = parts.flatMap(({ key, ...options }) => this.lines(key, options));
      if (lines.length) lines.push(...this.lines(`${joint}_torque`, { label: torque.name, colour: () => theme.inks.ink }));
      return { label: `${name} torque, ${leg.label.toLowerCase()}`, unit: torque.unit, lines: lines.filter((line) => line.leg.side === leg.side) };
    });
    return { name: `Parts of the torque, ${leg.label.toLowerCase()} leg`, panels };
  },

  // Add a panel with the difference of two runs.
  compared(panel) {
    if (this.runs.length < 2) return [panel];
    const [first, second] = this.runs;
    const lines = panel.lines.filter((line) => line.run === first).flatMap((line) => {
      const other = panel.lines.find((one) => one.run === second && one.key === line.key && one.leg.side === line.leg.side);
      return other ? [{ ...line, series: this.difference(line.series, other.series) }] : [];
    });
    return [panel, ...(lines.length ? [{ label: `B − A: ${panel.label.toLowerCase()}`, unit: panel.unit, lines, below: true }] : [])];
  },

  // Compute the difference of two series at every point of either, within their common span.
  difference(here, there) {
    const from = Math.max(here.times[0], there.times[0]), to = Math.min(here.times.at(-1), there.times.at(-1));
    const times = [...new Set([...here.times, ...there.times])].filter((time) => time >= from && time <= to).sort((a, b) => a - b);
    return { times, values: times.map((time) => value_at(there, time) - value_at(here, time)) };
  },

  // Write the names of the lines below the curves.
  name(set) {
    const entries = new Map();
    for (const line of (set ? set.panels : []).flatMap((panel) => panel.lines)) {
      const label = `${line.run.name ? `${line.run.name} ` : ""}${line.label ?? line.leg.label.toLowerCase()}`;
      if (!entries.has(label)) entries.set(label, line);
    }
    element("keys-to-lines").replaceChildren(...[...entries].map(([label, line]) => {
      const item = make("span"), chip = make("i", line.dash.length ? "line dashed" : "line");
      chip.style.color = line.colour();
      item.append(chip, label);
      return item;
    }));
    const labels = this.panels.map((panel) => panel.label).join(", ");
    element("curves").setAttribute("aria-label", `Curves over time: ${labels}`);
  },

  // Compute ranges that contain every line, in round steps.
  fit() {
    for (const panel of this.panels) {
      let low = Infinity, high = -Infinity;
      for (const { series: { values } } of panel.lines) {
        for (const value of values) if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
      }
      if (!(low <= high)) { low = 0; high = 1; }
      const least = panel.unit === "°" && !panel.below ? 20 : 1, slack = Math.max(high - low, least) - (high - low);
      panel.low = low - slack / 2 - 0.04 * (high - low + slack);
      panel.high = high + slack / 2 + 0.04 * (high - low + slack);
      panel.step = nice_step((panel.high - panel.low) / 4.5);
    }
  },

  // ---- span of time

  shown() {
    if (this.end === null) return [Math.max(0, this.time - WINDOW), Math.max(0, this.time - WINDOW) + WINDOW];
    const end = Math.max(this.end, SHORTEST);
    if (this.whole || document.body.classList.contains("printing")) return [0, end];
    const length = this.span ? this.span[1] - this.span[0] : Math.min(WINDOW, end);
    if (this.span && this.time >= this.span[0] && this.time <= this.span[1]) return this.span;
    // If the clock has left the span, the span follows.
    const from = Math.min(Math.max(this.time - length / 2, 0), end - length);
    if (this.span) this.span = [from, from + length];
    return [from, from + length];
  },

  zoom(factor, about = this.time) {
    if (this.end === null) return;
    const [from, to] = this.shown(), end = Math.max(this.end, SHORTEST);
    const length = Math.min(Math.max((to - from) * factor, SHORTEST), end);
    const left = about - ((about - from) / (to - from)) * length;
    this.limit(left, left + length);
  },

  limit(from, to) {
    const length = Math.min(to - from, this.end), left = Math.min(Math.max(from, 0), this.end - length);
    this.whole = length >= this.end - 1e-9;
    this.span = [left, left + length];
    this.draw();
  },

  reset() { this.span = null; this.whole = false; this.draw(); },
  toggle_whole() { this.whole = !this.whole; this.span = null; this.draw(); },

  // ---- pointer

  listen() {
    const canvas = element("curves");
    element("zoom-in").onclick = () => this.zoom(0.5);
    element("zoom-out").onclick = () => this.zoom(2);
    element("whole").onclick = () => this.toggle_whole();
    canvas.ondblclick = () => this.reset();
    canvas.onwheel = (event) => {
      if (this.end === null) return;
      event.preventDefault();
      this.zoom(1.2 ** (event.deltaY / 60), this.time_at(event));
    };
    canvas.onpointerdown = (event) => {
      if (this.end === null || event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      this.drag = { start: this.time_at(event), end: this.time_at(event), x: event.clientX, moved: false };
    };
    canvas.onpointermove = (event) => {
      if (!this.drag) return;
      this.drag.end = this.time_at(event);
      this.drag.moved ||= Math.abs(event.clientX - this.drag.x) > 4;
      this.draw();
    };
    canvas.onpointercancel = () => { this.drag = null; this.draw(); };
    canvas.onpointerup = () => {
      const drag = this.drag;
      this.drag = null;
      if (!drag) return;
      const [from, to] = [Math.min(drag.start, drag.end), Math.max(drag.start, drag.end)];
      if (!drag.moved) { if (this.onseek) this.onseek(drag.start); }
      else if (to - from >= SHORTEST) {
        if (this.onseek && (this.time < from || this.time > to)) this.onseek(from);
        this.limit(from, to);
      } else this.draw();
    };
  },

  time_at(event) {
    const box = element("curves").getBoundingClientRect(), [from, to] = this.shown();
    const column = box.width / this.columns, wide = column - MARGIN.left - MARGIN.right;
    const share = (((event.clientX - box.left) % column) - MARGIN.left) / wide;
    return Math.min(Math.max(from + share * (to - from), from), to);
  },

  // ---- drawing

  layout() {
    const canvas = element("curves"), width = canvas.clientWidth, n = Math.max(this.panels.length, 1);
    const pair = this.panels.some((panel) => panel.below);
    // If the panels do not fit below each other, they are in two columns: angles, and torques next to them.
    this.two_columns = width <= 760 && !pair && n > 4 && this.available_height() < 76 * n + 60;
    this.columns = this.two_columns ? 2 : width > 760 ? (pair ? n / 2 : Math.min(n, 4)) : 1;
    const rows = Math.ceil(n / this.columns), bands = this.columns === 1 ? this.banded().length : 0;
    const head = bands * (BAND + 3) + (bands ? 3 : 0);
    const available = this.available_height() - head - AXIS;
    const high = Math.floor(Math.min(Math.max(available / rows, 76), rows < 3 ? 190 : 128));
    const height = head + rows * high + AXIS;
    if (canvas.clientHeight !== height) canvas.style.height = `${height}px`;
    return { canvas, width, height, head, high, rows, wide: width / this.columns };
  },

  // Return the available height for the curves in the layout of the page.
  available_height() {
    const card = element("plots"), position = getComputedStyle(card).position;
    if (document.body.classList.contains("printing")) return 560;
    const inside = card.scrollHeight - element("curves").clientHeight;
    if (getComputedStyle(document.body).display === "grid") return 0.36 * window.innerHeight - inside;
    if (position !== "fixed") return Infinity;
    return element("bar").getBoundingClientRect().top - card.getBoundingClientRect().top - inside - 12;
  },

  banded() { return this.runs.flatMap((run) => run.legs.filter((leg) => leg.phases).map((leg) => [run, leg])); },

  show(time) { this.time = time; this.draw(); },

  draw() {
    if (!this.panels.length || !element("curves").clientWidth) return;
    const { canvas, width, height, head, high, rows, wide } = this.layout();
    const context = canvas_context(canvas, width, height), [from, to] = this.shown();
    element("whole").setAttribute("aria-pressed", String(this.whole));
    if (head) this.bands(context, width, from, to);
    const order = this.columns > 1 && this.panels.some((panel) => panel.below)
      ? [...this.panels.filter((panel) => !panel.below), ...this.panels.filter((panel) => panel.below)] : this.panels;
    order.forEach((panel, index) => {
      const [row, column] = this.two_columns ? [index % rows, Math.floor(index / rows)] : [Math.floor(index / this.columns), index % this.columns];
      const box = {
        left: column * wide + MARGIN.left, right: (column + 1) * wide - MARGIN.right,
        top: head + row * high + MARGIN.top, bottom: head + (row + 1) * high - MARGIN.bottom,
      };
      this.panel(context, panel, box, from, to, this.two_columns ? row === rows - 1 : index + this.columns >= order.length);
    });
  },

  bands(context, width, from, to) {
    this.banded().forEach(([run, leg], row) => {
      const box = { left: MARGIN.left, top: row * (BAND + 3), width: width - MARGIN.left - MARGIN.right, height: BAND };
      context.font = `650 10px ${FONT}`;
      context.textAlign = "right";
      context.fillStyle = theme.inks.soft;
      context.fillText(run.name ? `${run.name} ${leg.label[0]}` : leg.label.slice(0, 5), MARGIN.left - 5, box.top + 10.5);
      draw_band(context, run.page, leg.phases, box, from, to, run.page.duration);
    });
  },

  panel(context, panel, box, from, to, lowest) {
    const x = (t) => box.left + ((box.right - box.left) * (t - from)) / (to - from);
    const y = (v) => box.bottom - ((box.bottom - box.top) * (v - panel.low)) / (panel.high - panel.low);
    this.axes(context, panel, box, x, y, from, to, lowest);
    context.save();
    context.beginPath();
    context.rect(box.left, box.top - 3, box.right - box.left, box.bottom - box.top + 6);
    context.clip();
    if (this.drag && this.drag.moved) {
      context.fillStyle = theme.inks.line;
      context.globalAlpha = 0.7;
      context.fillRect(x(this.drag.start), box.top - 3, x(this.drag.end) - x(this.drag.start), box.bottom - box.top + 6);
      context.globalAlpha = 1;
    }
    for (const line of panel.lines) this.line(context, line, panel.below ? [] : line.dash, x, y, from, to);
    for (const run of new Set(panel.lines.map((line) => line.run))) draw_events(context, run.page.events, x, box, panel === this.panels[0]);
    context.restore();
    if (this.time < from - 1e-9 || this.time > to + 1e-9) return;
    context.strokeStyle = theme.inks.ink;
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(x(this.time), box.top - 3);
    context.lineTo(x(this.time), box.bottom + 3);
    context.stroke();
  },

  axes(context, panel, box, x, y, from, to, lowest) {
    context.font = `600 11px ${FONT}`;
    context.fillStyle = theme.inks.ink;
    context.textAlign = "left";
    context.fillText(`${panel.label} [${panel.unit}]`, box.left - (this.two_columns ? 24 : 0), box.top - 7);
    context.font = `11px ${FONT}`;
    context.fillStyle = theme.inks.soft;
    context.strokeStyle = theme.inks.line;
    context.lineWidth = 1;
    context.textAlign = "right";
    const digits = Math.max(0, -Math.floor(Math.log10(panel.step) + 1e-9));
    for (let k = Math.ceil(panel.low / panel.step); k * panel.step <= panel.high; k += 1) {
      const value = k * panel.step;
      context.beginPath();
      context.moveTo(box.left, y(value));
      context.lineTo(box.right, y(value));
      context.stroke();
      context.fillText(number(value, digits), box.left - 5, y(value) + 4);
    }
    if (lowest) this.clock(context, box, x, from, to);
  },

  clock(context, box, x, from, to) {
    context.textAlign = "center";
    if (this.strides) { this.percents(context, box, x, from, to); return; }
    const step = nice_step((to - from) / Math.max((box.right - box.left) / 55, 2)), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9; k += 1) {
      if (x(k * step) < box.right - 16) context.fillText((k * step).toFixed(digits), x(k * step), box.bottom + 18);
    }
    context.textAlign = "right";
    context.fillText("s", box.right, box.bottom + 18);
  },

  // Draw the number of each stride at its start, and per cent of the stride in between.
  percents(context, box, x, from, to) {
    const { side, starts } = this.strides, mean = (starts.at(-1) - starts[0]) / (starts.length - 1);
    const labels = (x(from + mean) - x(from)) / 40, each = [10, 20, 50].find((percent) => (labels * percent) / 100 >= 1) ?? 100;
    const every = Math.max(Math.ceil(1 / labels), 1); // one label for this number of strides
    starts.forEach((start, k) => {
      const next = starts[k + 1] ?? start + mean;
      for (let percent = 0; percent < (k + 1 < starts.length ? 100 : 1); percent += each) {
        const at = x(start + ((next - start) * percent) / 100);
        if (at < box.left || at > box.right - 62 || (percent === 0 && k % every)) continue;
        context.font = `${percent ? "" : "650 "}11px ${FONT}`;
        context.fillText(percent ? String(percent) : `${side[0].toUpperCase()}${k + 1}`, at, box.bottom + 18);
      }
    });
    context.font = `11px ${FONT}`;
    context.textAlign = "right";
    context.fillText("% stride", box.right, box.bottom + 18);
  },

  // Draw a line. If many points share a pixel column, the first, lowest, highest and last give the same picture.
  line(context, line, dash, x, y, from, to) {
    const { times, values } = line.series;
    context.strokeStyle = line.colour();
    context.lineWidth = 1.7;
    context.lineJoin = "round";
    context.setLineDash(dash);
    context.beginPath();
    let drawing = false, column = null, place = [];
    const go = (i) => {
      if (drawing) context.lineTo(x(times[i]), y(values[i])); else context.moveTo(x(times[i]), y(values[i]));
      drawing = true;
    };
    const flush = () => { for (const i of new Set([...place].sort((a, b) => a - b))) go(i); place = []; };
    for (let i = Math.max(last_before(times, from) - 1, 0); i < times.length; i += 1) {
      const here = Math.floor(2 * x(times[i]));
      if (here !== column) flush();
      column = here;
      if (!Number.isFinite(values[i])) { flush(); drawing = false; continue; }
      const [first = i, low = i, high = i] = place;
      place = [first, values[i] < values[low] ? i : low, values[i] > values[high] ? i : high, i];
      if (times[i] > to) break;
    }
    flush();
    context.stroke();
    context.setLineDash([]);
  },
};

// Return the smallest 1, 2 or 5 times a power of ten that is not smaller than a number.
function nice_step(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= least * (1 - 1e-9));
}
