// ---- timeline: bands of phases, slider, legend ------------------------------------------------------

const timeline = {
  runs: [], end: 0,

  build(runs, end) {
    this.runs = runs;
    this.end = end;
    const bands = element("bands");
    bands.replaceChildren();
    for (const [run, leg] of this.banded()) {
      const name = make("span", "", `${run.name}${run.name ? " " : ""}${leg.label[0]}`), canvas = make("canvas");
      name.title = leg.label;
      canvas.title = run.page.events.map((event) => `${event.time.toFixed(3)} s: ${event.text}`).join("\n");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Phases of the ${leg.label.toLowerCase()} leg${run.name ? ` of run ${run.name}` : ""}`);
      bands.append(name, canvas);
    }
    element("time").max = String(end ?? 0);
    this.legend(runs[0].page);
    this.draw();
  },

  banded() { return this.runs.flatMap((run) => run.legs.filter((leg) => leg.phases).map((leg) => [run, leg])); },

  legend(page) {
    const items = page.phases.map((phase, code) => {
      const item = make("span"), chip = make("canvas", "chip");
      item.append(chip, phase.label);
      chip.setAttribute("aria-hidden", "true");
      chip.dataset.code = String(code);
      return item;
    });
    if (page.events.length) {
      const item = make("span"), chip = make("i", "event");
      item.append(chip, [...new Set(page.events.map((event) => event.kind))].join(", "));
      items.push(item);
    }
    if (page.arrow) {
      const item = make("span"), chip = make("i", "arrow");
      chip.style.background = page.arrow.colour;
      item.append(chip, page.arrow.label);
      items.push(item);
    }
    for (const arc of page.arcs ?? []) {
      const item = make("span"), chip = make("i", "arc");
      chip.style.borderColor = arc.colour;
      item.append(chip, arc.label);
      items.push(item);
    }
    element("legend").replaceChildren(...items, make("span", "end", page.footnote));
    for (const chip of element("legend").querySelectorAll(".chip")) {
      const code = Number(chip.dataset.code), phase = page.phases[code], context = canvas_context(chip, 24, 14);
      draw_phase(context, phase, code, 0, 0, 24, 14);
      context.font = `650 10px ${FONT}`;
      context.textAlign = "center";
      context.fillStyle = phase.ink;
      context.fillText(phase.short, 12, 10.6);
    }
  },

  draw() {
    const canvases = element("bands").querySelectorAll("canvas");
    this.banded().forEach(([run, leg], index) => {
      const width = Math.max(canvases[index].clientWidth, 1);
      const context = canvas_context(canvases[index], width, BAND);
      const box = { left: 0, top: 0, width: (width * run.page.duration) / Math.max(this.end, 1e-9), height: BAND };
      draw_band(context, run.page, leg.phases, box, 0, run.page.duration, run.page.duration);
      const x = (time) => (box.width * time) / Math.max(run.page.duration, 1e-9);
      draw_events(context, run.page.events, x, { left: 0, right: box.width, top: 0, bottom: BAND });
    });
    // The slider covers the bands only; its thumb is 12 px wide.
    const left = canvases.length ? canvases[0].offsetLeft : 0;
    element("time").style.left = `${left - 6}px`;
    element("time").style.width = `calc(100% - ${left}px + 12px)`;
  },

  show(time, words) {
    element("time").value = String(time);
    element("time").setAttribute("aria-valuetext", words);
  },
};
