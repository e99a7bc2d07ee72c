// ---- the live viewer: what comes over a web socket --------------------------------------------------

const LIVE_MEMORY = 8; // seconds that a live page remembers

const live = {
  page: null, run: null, stage: null, head: null,

  open(page) {
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
    theme.listeners.push(() => { if (this.run) plots.choose(); });
    if (page.socket !== null) this.connect(page.socket ?? "/socket");
  },

  // The address holds the token that lets in. What comes next waits until this has been drawn.
  connect(path) {
    const socket = new WebSocket(`ws://${location.host}${path}${location.search}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (message) => {
      this.stage.take(new Uint8Array(message.data));
      requestAnimationFrame(() => { if (socket.readyState === WebSocket.OPEN) socket.send("drawn"); });
    };
    socket.onclose = () => tell("The viewer has ended.");
  },

  describe(page) {
    this.page = page;
    document.title = page.title;
    document.body.classList.toggle("still", !page.legs.length);
    const legs = page.legs.map((leg) => ({
      ...leg, phases: null,
      series: Object.fromEntries(leg.shows.filter((key) => key !== "phase").map((key) => [key, []])),
    }));
    this.run = { name: "", page, legs, times: [] };
    this.head.build(page);
    this.stage.floor = page.floor;
    timeline.legend(page);
    if (legs.length) plots.open([this.run], null);
    this.stage.look(page.view);
  },

  // One moment, or several since the last drawing.
  show(...samples) {
    if (!this.run || !this.run.legs.length || !samples.length) return;
    for (const sample of samples) this.note(sample);
    const last = samples[samples.length - 1];
    this.forget(last_before(this.run.times, last.time - LIVE_MEMORY));
    this.head.show(last);
    plots.fit();
    plots.show(last.time);
  },

  note(sample) {
    const { times, legs } = this.run;
    if (times.length && sample.time < times[times.length - 1]) this.forget(times.length);
    times.push(sample.time);
    legs.forEach((leg, index) => {
      for (const [key, values] of Object.entries(leg.series)) values.push(sample.legs[index][key] ?? NaN);
    });
  },

  forget(count) {
    this.run.times.splice(0, count);
    for (const leg of this.run.legs) for (const values of Object.values(leg.series)) values.splice(0, count);
  },
};
