// ---- recorded runs: one clock -----------------------------------------------------------------------

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];

const player = {
  runs: [], stages: [], heads: [], times: [], switches: [], end: 0, time: 0, playing: false, last: null,
  by_stride: false, // two runs: whether B is shown at the same point of the same stride as A

  async open(page) {
    const pair = page.runs.length > 1;
    document.body.classList.toggle("pair", pair);
    for (const [index, data] of page.runs.entries()) await this.add(data, pair ? "AB"[index] : "");
    this.by_stride = this.has_strides();
    this.align();
    const requested = address.read();
    this.speeds(requested.speed);
    document.title = this.runs.map((run) => run.page.title).join(" | ");
    plots.onseek = (time) => { this.pause(); this.seek(time); };
    this.controls();
    this.seek(requested.time ?? 0, false);
    this.stages.forEach((stage, index) => stage.look(this.runs[index].page.view));
    const calm = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (requested.time === null && !calm && !requested.picture) this.play();
    requestAnimationFrame((now) => this.tick(now));
  },

  has_strides() { return this.runs.length > 1 && this.runs.every((run) => run.page.strides); },

  // Convert the time of a run to the common clock, and back.
  shared(run, time) { return run === this.runs[0] || !this.by_stride ? time : map_time(run.page.strides.starts, this.runs[0].page.strides.starts, time); },
  own(run, time) {
    if (run === this.runs[0] || !this.by_stride) return time;
    return Math.round(1e6 * map_time(this.runs[0].page.strides.starts, run.page.strides.starts, time)) / 1e6;
  },

  // Convert all data that are drawn over time to the common clock.
  align() {
    const views = this.runs.map((run) => {
      const shared = (time) => this.shared(run, time);
      const legs = run.legs.map((leg) => ({
        ...leg, phases: leg.phases && { ...leg.phases, starts: leg.phases.starts.map(shared) },
        series: Object.fromEntries(Object.entries(leg.series).map(([key, { times, values }]) => [key, { times: times.map(shared), values }])),
      }));
      const events = run.page.events.map((event) => ({ ...event, time: shared(event.time) }));
      return { ...run, legs, times: run.times.map(shared), page: { ...run.page, events, duration: shared(run.page.duration) } };
    });
    this.end = Math.max(...views.map((run) => run.page.duration));
    const moments = new Set(views.flatMap((run) => run.times.map((t) => Math.round(1000 * t))));
    this.times = [...moments].filter((t) => t >= 0).sort((a, b) => a - b).map((t) => t / 1000);
    this.switches = this.transitions(views);
    timeline.build(views, this.end);
    plots.strides = this.by_stride ? this.runs[0].page.strides : null;
    plots.open(views, this.end);
    element("by-stride").hidden = !this.has_strides();
    element("by-stride").setAttribute("aria-pressed", String(this.by_stride));
  },

  compare_by(stride) {
    this.by_stride = stride && this.has_strides();
    this.align();
    this.seek(this.time);
  },

  async add(page, name) {
    const frames = JSON.parse(new TextDecoder().decode(await inflate(page.frames)));
    const legs = page.legs.map((leg, index) => ({ ...leg, phases: frames.legs[index].phases, series: unfolded(frames.legs[index].series) }));
    const run = { name, page, legs, modes: frames.modes, times: frames.times.map((t) => t / 1000) };
    const stage = new Stage(name ? `Scene of run ${name}` : "Scene");
    const head = new Readout(stage.head, name);
    this.runs.push(run);
    this.stages.push(stage);
    this.heads.push(head);
    head.build(page);
    run.scales = this.scales(run);
    stage.open();
    stage.floor = page.floor;
    stage.receive(await inflate(page.scene));
    stage.viewer.animator.pause();
    stage.paint();
  },

  // Return the largest motor torque of each joint, which scales the small bars.
  scales(run) {
    const largest = (joint) => run.legs.flatMap((leg) => leg.series[`${joint}_torque`]?.values ?? [])
      .reduce((most, value) => (Number.isFinite(value) ? Math.max(most, Math.abs(value)) : most), 1);
    return Object.fromEntries(JOINTS.map(([joint]) => [joint, largest(joint)]));
  },

  // Return every change of a phase of any leg, and every event: [{time, words}].
  transitions(runs) {
    const found = runs.flatMap((run) => run.legs.filter((leg) => leg.phases).flatMap((leg) =>
      leg.phases.starts.slice(1).map((time, index) => ({
        time, words: `${run.name ? `run ${run.name}, ` : ""}${leg.label.toLowerCase()} leg: ${run.page.phases[leg.phases.codes[index + 1]].label.toLowerCase()}`,
      }))));
    const events = runs.flatMap((run) => run.page.events.map(({ time, text }) => ({
      time, words: `${run.name ? `run ${run.name}, ` : ""}${text}`,
    })));
    return [...found, ...events].sort((a, b) => a.time - b.time);
  },

  speeds(requested) {
    const values = [...new Set([...SPEEDS, ...(requested ? [requested] : [])])].sort((a, b) => a - b);
    element("speed").replaceChildren(...values.map((value) => {
      const option = make("option", "", `${value}×`);
      option.value = String(value);
      return option;
    }));
    element("speed").value = String(requested ?? 1);
  },

  controls() {
    element("play").onclick = () => this.toggle();
    element("previous").onclick = () => this.transit(-1);
    element("next").onclick = () => this.transit(1);
    element("view").onclick = () => this.look();
    element("by-stride").onclick = () => this.compare_by(!this.by_stride);
    element("time").oninput = () => { this.pause(); this.seek(Number(element("time").value)); };
    element("help-open").onclick = () => element("help").showModal();
    // After a click, the space bar plays the run instead of pressing the same button again.
    document.addEventListener("click", (event) => { if (event.detail) event.target.closest("button")?.blur(); });
    window.addEventListener("hashchange", () => {
      const { time } = address.read();
      if (time !== null) { this.pause(); this.seek(time, false); }
    });
    window.addEventListener("resize", () => this.redraw());
    theme.listeners.push(() => { plots.choose(); this.redraw(); });
    window.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("beforeprint", () => this.print(true));
    window.addEventListener("afterprint", () => this.print(false));
  },

  look() { this.stages.forEach((stage, index) => stage.look(this.runs[index].page.view)); },
  redraw() { timeline.draw(); plots.draw(); },

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || element("help").open) return;
    if (event.target.tagName === "SELECT") return;
    if (["Space", "Enter"].includes(event.code) && event.target.tagName === "BUTTON") return; // handled by the button
    const action = this.keys()[event.code === "Space" ? " " : event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    action(event.shiftKey);
    event.preventDefault();
  },

  keys() {
    const go = (time) => { this.pause(); this.seek(time); };
    const step = (way, far) => (far ? go(this.time + 0.5 * way) : this.step(way));
    return {
      " ": () => this.toggle(),
      ArrowLeft: (far) => step(-1, far), ArrowRight: (far) => step(1, far),
      Home: () => go(0), End: () => go(this.end),
      ",": () => this.transit(-1), ".": () => this.transit(1),
      "+": () => this.faster(1), "=": () => this.faster(1), "-": () => this.faster(-1),
      a: () => plots.toggle_whole(), r: () => this.look(), s: () => this.compare_by(!this.by_stride), t: () => theme.set(!theme.dark),
      "?": () => element("help").showModal(),
    };
  },

  faster(way) {
    const choice = element("speed");
    choice.selectedIndex = Math.min(Math.max(choice.selectedIndex + way, 0), choice.options.length - 1);
    element("spoken").textContent = `speed ${choice.value}`;
  },

  // Go to the next or the previous frame.
  step(way) {
    this.pause();
    const index = last_before(this.times, this.time) + way;
    this.seek(this.times[Math.min(Math.max(index, 0), this.times.length - 1)]);
  },

  // Go to the next or the previous change of a phase.
  transit(way) {
    this.pause();
    const ahead = this.switches.filter(({ time }) => (way > 0 ? time > this.time + 5e-4 : time < this.time - 5e-4));
    const goal = way > 0 ? ahead[0] : ahead[ahead.length - 1];
    if (!goal) { element("spoken").textContent = way > 0 ? "no later transition" : "no earlier transition"; return; }
    this.seek(goal.time);
    const words = this.switches.filter(({ time }) => Math.abs(time - goal.time) < 5e-4).map((one) => one.words);
    element("spoken").textContent = `${goal.time.toFixed(3)} s, ${words.join("; ")}`;
  },

  toggle() { if (this.playing) { this.pause(); this.seek(this.time); } else this.play(); },

  play() {
    if (this.time >= this.end) this.time = 0;
    this.playing = true;
    this.last = null;
    element("play").textContent = "Pause";
  },

  pause() {
    this.playing = false;
    element("play").textContent = "Play";
  },

  tick(now) {
    requestAnimationFrame((next) => this.tick(next));
    if (!this.playing) return;
    const passed = this.last === null ? 0 : Math.min((now - this.last) / 1000, 0.5);
    this.last = now;
    const time = this.time + passed * Number(element("speed").value);
    this.show(time > this.end ? 0 : time);
  },

  // Show the nearest frame, so that picture and numbers of a paused page are those of one row of the log.
  seek(time, write_address = true) {
    const low = last_before(this.times, time), high = Math.min(low + 1, this.times.length - 1);
    const nearer = Math.abs(this.times[high] - time) < Math.abs(time - this.times[low]) ? high : low;
    this.show(this.times[nearer]);
    if (write_address) address.write(this.time);
  },

  show(time) {
    this.time = Math.min(Math.max(time, 0), this.end);
    this.runs.forEach((run, index) => {
      const time = Math.min(Math.max(this.own(run, this.time), 0), run.page.duration);
      this.stages[index].seek(time);
      this.heads[index].show(this.sample(run, time), run.scales);
    });
    plots.show(this.time);
    timeline.show(this.time, this.words());
  },

  words() {
    const legs = this.runs.flatMap((run) => run.legs.filter((leg) => leg.phases).map((leg) =>
      `${run.name} ${leg.label.toLowerCase()} ${run.page.phases[spell(leg.phases, this.own(run, this.time))].label.toLowerCase()}`.trim()));
    return [`${this.time.toFixed(2)} seconds`, ...legs].join(", ");
  },

  // Return the values of the last frame and its time.
  sample(run, time) {
    const at = run.times[last_before(run.times, time)];
    const legs = run.legs.map((leg) => {
      const values = { phase: leg.phases ? spell(leg.phases, at) : -1 };
      for (const [key, series] of Object.entries(leg.series)) values[key] = value_at(series, at) ?? NaN;
      return values;
    });
    const mode = run.modes ? spell(run.modes, at) : undefined;
    return { time: at, legs, mode, events: run.page.events.filter((event) => event.time <= at + 5e-4), stride: this.stride(run, at) };
  },

  // Return the stride and the position in it as text, if runs are compared by stride.
  stride(run, time) {
    if (!this.by_stride) return "";
    const { side, starts } = run.page.strides, k = last_before(starts, time);
    if (time < starts[0] || k + 1 >= starts.length) return "";
    return `${side} stride ${k + 1}, ${((100 * (time - starts[k])) / (starts[k + 1] - starts[k])).toFixed(0)} %`;
  },

  // Prepare the page for printing: the picture and the numbers at this time, and the curves of the whole run.
  print(begins) {
    if (begins) {
      this.pause();
      this.was_dark = theme.dark;
      if (theme.dark) theme.set(false);
      for (const stage of this.stages) stage.copy_to_picture();
      element("printed").textContent = `The scene at ${this.time.toFixed(3)} s; curves of the whole run of ${this.end.toFixed(2)} s; ` +
        `the line marks this time. ${this.runs[0].page.footnote}.`;
    }
    document.body.classList.toggle("printing", begins);
    if (!begins && this.was_dark) theme.set(true);
    this.redraw();
  },
};

// ---- address of the page: #t=3.200, and speed, theme, picture ---------------------------------------

const address = {
  read() {
    const words = new URLSearchParams(location.hash.slice(1));
    const given = (name) => {
      const text = words.get(name), value = text ? Number(text) : NaN;
      return Number.isFinite(value) ? value : null;
    };
    const speed = given("speed"), shade = words.get("theme");
    return {
      time: given("t"), speed: speed > 0 && speed <= 100 ? speed : null,
      theme: ["light", "dark"].includes(shade) ? shade : null, picture: words.has("picture"),
    };
  },

  // Some browsers do not allow a change of the address of a local file; the page works without it.
  write(time) {
    try { history.replaceState(null, "", `#t=${time.toFixed(3)}`); } catch { /* the page works without it */ }
  },
};

// Convert a series with steps in ms to a series with times in s.
function unfolded(series) {
  return Object.fromEntries(Object.entries(series).map(([key, { steps, values }]) => {
    let now = 0;
    return [key, { times: steps.map((step) => (now += step) / 1000), values: values.map((value) => value ?? NaN) }];
  }));
}

function spell(phases, time) { return phases.codes[last_before(phases.starts, time)]; }

async function inflate(text) {
  const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
