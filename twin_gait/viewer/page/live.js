// ---- live viewer: data that the script of the panel passes on ----------------------------------------

const LIVE_MEMORY = 8; // seconds of curves that a live page stores

const live = {
  page: null, run: null, stage: null, head: null, time: -Infinity,

  open() {
    this.stage = new Stage("Scene");
    this.head = new Readout(this.stage.head);
    this.stage.open();
    const inner = this.stage.viewer.handle_command.bind(this.stage.viewer);
    this.stage.viewer.handle_command = (command) => {
      if (command.type === "page") this.describe(command.page);
      else if (command.type === "sample") this.show(command.sample);
      else inner(command);
    };
    element("view").onclick = () => { if (this.page) this.stage.look(this.page.view); };
    window.addEventListener("resize", () => plots.draw());
    window.addEventListener("keydown", (event) => this.key(event));
    theme.listeners.push(() => { if (this.run) plots.choose(); });
  },

  key(event) {
    const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && !["range", "checkbox"].includes(event.target.type);
    if (event.ctrlKey || event.altKey || event.metaKey || typing) return;
    if (event.key === "r") element("view").click();
    if (event.key === "t") element("theme").click();
  },

  describe(page) {
    this.page = page;
    document.title = page.title;
    document.body.classList.toggle("still", !page.legs.length);
    document.body.classList.toggle("many", JOINTS.filter(([joint]) => page.legs.some((leg) => leg.shows.includes(joint))).length > 2);
    const legs = page.legs.map((leg) => ({
      ...leg, phases: null,
      series: Object.fromEntries(leg.shows.filter((key) => key !== "phase").map((key) => [key, { times: [], values: [] }])),
    }));
    this.run = { name: "", page, legs };
    this.time = -Infinity;
    this.head.build(page);
    this.stage.floor = page.floor;
    timeline.legend(page);
    if (legs.length) plots.open([this.run], null);
    this.stage.look(page.view);
  },

  // Show one sample, or several since the last drawing.
  show(...samples) {
    if (!this.run || !this.run.legs.length || !samples.length) return;
    for (const sample of samples) this.add_sample(sample);
    const last = samples.at(-1);
    this.page.events = last.events;
    this.remove_before(last.time - LIVE_MEMORY);
    this.head.show(last);
    plots.fit();
    plots.show(last.time);
  },

  add_sample(sample) {
    if (sample.time < this.time) this.remove_before(Infinity);
    this.time = sample.time;
    this.run.legs.forEach((leg, index) => {
      for (const [key, series] of Object.entries(leg.series)) {
        const added = sample.curves[index][key];
        series.times.push(...added.times);
        series.values.push(...added.values.map((value) => value ?? NaN));
      }
    });
  },

  remove_before(before) {
    for (const { times, values } of this.run.legs.flatMap((leg) => Object.values(leg.series))) {
      const count = times.length && times.at(-1) < before ? times.length : last_before(times, before);
      times.splice(0, count);
      values.splice(0, count);
    }
  },
};
