// ---- card with the numbers --------------------------------------------------------------------------

class Readout {
  constructor(card, name = "") {
    this.card = card;
    this.name = name;
    this.cells = [];
    theme.listeners.push(() => this.tint());
  }

  build(page) {
    this.page = page;
    const title = make("h1", "title", page.title);
    if (this.name) title.prepend(make("span", "badge", this.name));
    this.clock = make("p", "clock");
    this.mode = make("p", "mode");
    this.table = make("table", "read");
    this.alarm = make("ul", "alarm");
    this.alarm.setAttribute("role", "status");
    this.card.replaceChildren(title, this.subtitle(), this.clock, this.mode, this.alarm, this.table,
      make("p", "notes", page.notes.join(" ")));
    if (page.walk?.length) this.card.append(Readout.measures("Measures of the walk", page.walk));
    this.cells = page.legs.map(() => ({}));
    this.rows = Readout.rows(page);
    if (page.legs.length) this.fill();
  }

  // Make the subtitle; parts that differ from the other run are emphasised.
  subtitle() {
    const line = make("p", "subtitle");
    for (const text of this.page.subtitle) {
      if (line.childNodes.length) line.append(" · ");
      line.append(this.page.differing.includes(text) ? make("strong", "", text) : text);
    }
    return line;
  }

  // Make a table of texts that the user can open.
  static measures(title, [head, ...rows]) {
    const box = make("details", "walk"), frame = make("div"), table = make("table", "read");
    frame.append(table);
    box.append(make("summary", "", title), frame);
    const top = table.createTHead().insertRow(), body = table.createTBody();
    for (const text of head) top.append(make("th", "", text));
    for (const [label, ...texts] of rows) {
      const row = body.insertRow(), name = make("th", "", label);
      name.scope = "row";
      row.append(name);
      for (const text of texts) row.insertCell().textContent = text;
    }
    return box;
  }

  // Return the rows of the card: [key, label, decimals, unit, colour of a part of the torque].
  static rows(page) {
    const rows = [["phase", "Phase"]], { angle, torque, force, crutch } = page.labels;
    for (const [joint, label] of JOINTS) {
      rows.push([joint, `${label} ${angle.name}`, 1, angle.unit], [`${joint}_torque`, torque.name, 1, ` ${torque.unit}`]);
      for (const part of page.parts) rows.push([`${joint}_${part.key}`, part.label, 1, ` ${torque.unit}`, part.colour]);
    }
    rows.push(["force", capitalize(force.name), 0, ` ${force.unit}`], ["crutch", capitalize(crutch.name), 0, ` ${crutch.unit}`]);
    return rows.filter(([key]) => page.legs.some((leg) => leg.shows.includes(key)));
  }

  fill() {
    const top = this.table.createTHead().insertRow(), body = this.table.createTBody();
    top.append(make("td"));
    for (const leg of this.page.legs) {
      const cell = make("th", "", leg.label);
      cell.scope = "col";
      top.append(cell);
    }
    this.tint();
    for (const [key, label, , , colour] of this.rows) {
      const row = body.insertRow(), name = make("th", "", label);
      row.className = colour ? "part" : key.endsWith("_torque") ? "motor" : "";
      name.scope = "row";
      if (colour) name.style.setProperty("--part", colour);
      row.append(name);
      this.page.legs.forEach((leg, index) => { this.cells[index][key] = this.cell(row, colour); });
    }
  }

  tint() {
    if (!this.table) return;
    const heads = this.table.querySelectorAll("thead th");
    this.page.legs.forEach((leg, index) => { if (heads[index]) heads[index].style.borderColor = theme.of(leg); });
  }

  cell(row, colour) {
    const cell = row.insertCell(), text = make("span"), bar = colour ? make("b") : null;
    if (bar) {
      const scale = make("i");
      bar.style.background = colour;
      scale.append(bar);
      cell.append(scale);
    }
    cell.append(text);
    return { text, bar };
  }

  // Show a sample; `scales` is the torque of each joint at which a bar is half as long as its cell.
  show(sample, scales = {}) {
    const { page } = this;
    this.clock.textContent = `${sample.time.toFixed(3)} s` +
      (page.duration === null ? "" : ` of ${page.duration.toFixed(2)} s${page.outcome ? `, ${page.outcome}` : ""}`);
    if (sample.stride) this.clock.textContent += `; ${sample.stride}`;
    this.mode.textContent = page.modes?.[sample.mode] ?? "";
    this.warn(sample.events ?? []);
    sample.legs.forEach((leg, index) => {
      for (const [key, , digits, unit] of this.rows) {
        const cell = this.cells[index][key];
        if (key === "phase") { this.pill(cell.text, page.phases[leg.phase]); continue; }
        const valid = Number.isFinite(leg[key]);
        cell.text.textContent = valid ? number(leg[key], digits) + unit : "–";
        if (cell.bar) this.bar(cell.bar, valid ? leg[key] / (scales[key.split("_")[0]] || 20) : 0);
      }
    });
  }

  // Show the events so far.
  warn(events) {
    const words = events.map(({ kind, time, text }) =>
      `${kind === "trip" ? text.replace("trip", "HOLD") : capitalize(text)} (${time.toFixed(3)} s)`);
    if (words.join() === this.warned) return;
    this.warned = words.join();
    this.alarm.replaceChildren(...words.map((text) => make("li", text.startsWith("HOLD") ? "hold" : "", text)));
  }

  bar(bar, share) {
    const width = 50 * Math.min(Math.abs(share), 1);
    bar.style.width = `${width.toFixed(1)}%`;
    bar.style.left = `${(share < 0 ? 50 - width : 50).toFixed(1)}%`;
  }

  pill(cell, phase) {
    if (cell.dataset.phase === (phase ? phase.name : "")) return;
    cell.dataset.phase = phase ? phase.name : "";
    const pill = make("span", "pill", phase ? phase.label : "–");
    if (phase) {
      pill.style.background = phase.colour;
      pill.style.color = phase.ink;
      pill.prepend(make("b", "", phase.short));
    }
    cell.replaceChildren(pill);
  }
}
