// ---- a model and its joints: sliders at the position of a run's curves ------------------------------

const joints = {
  stage: null, rows: [],

  async open({ runs: [page] }) {
    // Controls of time are hidden, as on a live page that shows no legs.
    document.body.classList.add("live", "still");
    document.title = page.title;
    this.stage = new Stage("Model");
    new Readout(this.stage.head).build(page);
    this.build(page.joints);
    this.stage.open();
    this.stage.floor = page.floor;
    this.stage.receive(await inflate(page.scene));
    this.stage.paint();
    this.reset();
    this.stage.look(page.view);
    element("view").onclick = () => this.stage.look(page.view);
    window.addEventListener("keydown", (event) => this.key(event));
  },

  build(entries) {
    const card = element("plots"), head = make("div"), zero = make("button", "small", "Zero"), list = make("div", "rows");
    head.id = "plot-tools";
    zero.type = "button";
    zero.title = "Every joint to zero, or to its limit that is nearest (Z)";
    zero.onclick = () => this.reset();
    head.append(make("h2", "grow", "Joints"), zero);
    this.rows = entries.map((entry) => this.row(entry, list));
    card.setAttribute("aria-label", "Joints");
    card.replaceChildren(head, list);
    document.body.classList.toggle("posed", entries.length > 0);
  },

  // Make the row of a joint; angles are in degrees, displacements in millimetres.
  row(entry, list) {
    const [factor, unit, digits] = entry.slides ? [1000, "\u202fmm", 1] : [180 / Math.PI, "°", 1];
    const label = make("label", "joint"), slider = make("input"), output = make("output");
    const end = (value) => make("span", "end", entry.free ? "" : number(factor * value, 0) + unit);
    Object.assign(slider, { type: "range", min: factor * entry.lower, max: factor * entry.upper, step: "any" });
    label.append(make("span", "name", entry.name), output, end(entry.lower), slider, end(entry.upper));
    label.title = entry.name + (entry.free ? " (no limits)" : "") + (entry.mimic ? ` (follows ${entry.mimic.joint})` : "");
    slider.disabled = Boolean(entry.mimic);
    list.append(label);
    const show = (value) => {
      output.textContent = number(factor * value, digits) + unit;
      slider.setAttribute("aria-valuetext", output.textContent);
      this.move(entry, value);
      this.follow(entry.name, value);
    };
    const row = { entry, show, slider, set: (value) => {
      slider.value = value;
      show(Number(slider.value) / factor);
    } };
    slider.oninput = () => row.set(slider.value);
    slider.ondblclick = () => row.set(0);
    return row;
  },

  // Move the joints with <mimic> that follow a joint; they may exceed their own limits.
  follow(leader, value) {
    for (const { entry, show, slider } of this.rows) {
      if (entry.mimic?.joint !== leader) continue;
      const position = entry.mimic.multiplier * value + entry.mimic.offset;
      slider.value = position * (entry.slides ? 1000 : 180 / Math.PI);
      show(position);
    }
  },

  // Turn the group of a joint about its axis, or shift it along the axis, from its position in the file.
  move({ path, slides, axis, position, quaternion }, value) {
    const { Quaternion, Vector3 } = MeshCat.THREE, along = new Vector3(...axis), rest = new Quaternion(...quaternion);
    const [name, moved] = slides
      ? ["position", along.applyQuaternion(rest).multiplyScalar(value).add(new Vector3(...position))]
      : ["quaternion", rest.multiply(new Quaternion().setFromAxisAngle(along, value))];
    this.stage.viewer.handle_command({ type: "set_property", path, property: name, value: moved.toArray() });
  },

  reset() { for (const row of this.rows) if (!row.entry.mimic) row.set(0); },

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key === "z") this.reset();
    if (event.key === "r") element("view").click();
    if (event.key === "t") element("theme").click();
  },
};
