// Panel of the live page. It draws the controls that the simulation declares, sends changes, and shows their
// results: the reason of a rejection is next to its control, which returns to the valid value.
// Messages are defined in twin_gait/live/protocol.py; a batch of messages is one list.
"use strict";

(() => {
  const get = (id) => document.getElementById(id);
  const TABS = [["walk", "Walk"], ["table", "Table"], ["monitor", "Monitor"], ["disturb", "Push & faults"], ["log", "Log"]];
  const HOMES = { push: "disturb", fault: "disturb" }; // tab of a group that has no own tab
  const PLACES = { push: "disturb", fault: "disturb", save: "table" }; // tab of an action
  const QUICK = ["walk", "pause", "step", "restart"]; // actions without a tab: always visible
  const APART = [...QUICK, "request", "stop", "revert"]; // actions with their own position
  const STATES = {
    walking: "Walking", paused: "Paused", waiting: "Waiting for a step", held: "HOLD",
    fell: "Fell", diverged: "Diverged", ended: "Ended", died: "Broken off: its process is gone",
    silent: "No data", offline: "Not connected", connecting: "Connecting…",
  };
  // The three controls of the monitor, each with its quantities.
  const MONITOR = [
    ["friction_control", "Friction control", ["gain"]], ["torque_control", "Torque control", ["torque"]],
    ["impedance_control", "Impedance control", ["stiffness", "equilibrium", "damping"]],
  ];
  const OVER = ["held", "fell", "diverged", "ended", "died"]; // states that only a restart can leave
  const GONE = ["ended", "died"]; // states without a process of the simulation
  const LOST = ["connecting", "offline", ...GONE]; // states in which nothing can be changed
  // Parts of the page that change something, without the emergency stop.
  const CHANGING = ["panel-quick", "panel-requests", "panel-forecast", "panel-ask", "body-walk", "body-table", "body-monitor", "body-disturb"];
  const SILENCE = 500, LOOK = 100, OTHER_WAY_AFTER = 250; // [ms]
  const ANSWER_WITHIN = 130000; // [ms]; long, because a restart first writes the run of the walk
  const LOG_LINES = 400;
  const USUAL_FRAME = 34, LONGEST_REST = 400; // [ms]
  const page = Math.random().toString(36).slice(2, 8);

  // ---- small helpers --------------------------------------------------------------------------------

  function make(tag, properties = {}, ...children) {
    const { dataset, aria, style, ...rest } = properties;
    const node = Object.assign(document.createElement(tag), rest);
    Object.assign(node.dataset, dataset);
    for (const [name, value] of Object.entries(aria ?? {})) node.setAttribute(`aria-${name}`, value);
    for (const [name, value] of Object.entries(style ?? {})) node.style.setProperty(name, value);
    node.append(...children);
    return node;
  }

  const words = (name) => name.replaceAll("_", " ");
  const title = (name) => words(name).replace(/^./, (letter) => letter.toUpperCase()).replace("θ0", "θ₀");

  function decimals(step) {
    if (!step) return 3;
    const text = String(step);
    return text.includes("e-") ? Number(text.split("e-")[1]) : (text.split(".")[1] ?? "").length;
  }

  function written(value, control) {
    if (typeof value === "boolean") return value ? "on" : "off";
    if (typeof value !== "number") return words(String(value));
    const text = value.toFixed(decimals(control?.step)).replace("-", "\u2212");
    return control?.unit ? `${text} ${unit(control.unit)}` : text;
  }

  const UNITS = { deg: "°", "Nm/deg": "N·m/°", Nm: "N·m", "Nms/rad": "N·m·s/rad", "": "" };
  const unit = (name) => UNITS[name] ?? name;

  // ---- connection -----------------------------------------------------------------------------------

  const link = {
    socket: null,
    count: 0,
    waiting: new Map(), // handler of the answer by the id of the message

    open() {
      this.socket = new WebSocket(`ws://${location.host}/panel${location.search}`);
      this.socket.onmessage = (message) => { for (const item of JSON.parse(message.data)) hear(item); };
      this.socket.onopen = () => get("panel").classList.remove("offline");
      this.socket.onclose = () => {
        get("panel").classList.add("offline");
        if (!GONE.includes(head.status)) head.state("offline");
        for (const answer of this.waiting.values()) answer(null);
        this.waiting.clear();
        setTimeout(() => this.open(), 1000);
      };
    },

    // Send a message; `answer` is called with the event that has its id, or with null after a timeout.
    send(message, answer) {
      const id = `${page}-${this.count += 1}`;
      if (this.socket?.readyState !== WebSocket.OPEN) { answer(null); return; }
      this.waiting.set(id, answer);
      setTimeout(() => { if (this.waiting.delete(id)) answer(null); }, ANSWER_WITHIN);
      this.socket.send(JSON.stringify({ ...message, id, user: "" }));
    },
  };

  // The scene has its own socket. The page acknowledges each batch after drawing it and receives no other batch
  // before, so that a slow page drops frames instead of falling behind.
  const view = {
    samples: [],

    open() {
      const { viewer } = twinGait.stage, inner = viewer.handle_command;
      viewer.handle_command = (command) => {
        if (command.type === "sample") this.samples.push(command.sample); else inner(command);
      };
      twinGait.stage.room = room;
      this.connect();
    },

    connect() {
      const socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
      socket.binaryType = "arraybuffer";
      socket.onmessage = (message) => {
        twinGait.take(new Uint8Array(message.data));
        twinGait.show(...this.samples.splice(0));
        this.answer(socket, performance.now());
      };
      socket.onclose = () => setTimeout(() => this.connect(), 1000);
    },

    // Without a graphics card drawing is slow; the page then waits for as long as it has drawn, so that the
    // simulation has enough processor time.
    answer(socket, began) {
      requestAnimationFrame(() => {
        const rest = Math.min(Math.max(performance.now() - began - USUAL_FRAME, 0), LONGEST_REST);
        setTimeout(() => { if (socket.readyState === WebSocket.OPEN) socket.send("drawn"); }, rest);
      });
    },
  };

  // Compute the part of the pane that no card covers: between the numbers and the panel.
  function room() {
    const box = (node) => node.getBoundingClientRect();
    const pane = box(this.pane), free = { left: pane.left, right: pane.right, top: pane.top, bottom: pane.bottom };
    if (getComputedStyle(this.section).position === "fixed") {
      free.left = Math.max(free.left, box(this.head).right);
      free.right = Math.min(free.right, box(get("panel")).left);
      free.bottom = Math.min(free.bottom, box(get("bar")).top);
    }
    if (free.right - free.left < 0.25 * pane.width) { free.left = pane.left; }
    return {
      width: pane.width, height: pane.height, wide: free.right - free.left, high: Math.max(free.bottom - free.top, 100),
      aside: (pane.left + pane.right - free.left - free.right) / 2, rise: (pane.top + pane.bottom - free.top - free.bottom) / 2,
    };
  }

  const NO_ANSWER = { response: "refused", text: "no answer from the simulation" };

  function hear(message) {
    if (message.kind === "page") log.open(message.session);
    if (message.kind === "page") board.colours = new Map(message.phases.map((phase) => [phase.name, phase]));
    else if (message.kind === "state") board.take(message);
    else if (message.kind === "frame") head.frame(message);
    else if (message.kind === "heartbeat") pulse.beat(message.time_since_message_s);
    else if (message.kind === "event") {
      log.add(message);
      const answer = link.waiting.get(message.id);
      if (answer && link.waiting.delete(message.id)) answer(message);
      else if (message.response === "refused" && message.subject === "") head.tell(message.text);
    }
  }

  // ---- head: state of the walk, actions that are always visible, stop ----------------------------------

  const head = {
    status: "connecting",
    events: 0, // number of faults, trips and falls of the walk

    // Show the state, with the cause and the joint of a trip, which follow the colon of its text.
    state(status, events = []) {
      const trip = events.find((event) => event.kind === "trip")?.text.split(": ")[1];
      const because = trip && ["held", "fell"].includes(status) ? `: ${status === "fell" ? "after a hold, " : ""}${trip}` : "";
      const turned = [OVER, LOST].some((list) => list.includes(this.status) !== list.includes(status));
      if (turned || this.events !== events.length) changes.again();
      if (["held", "fell"].includes(status) && status !== this.status) stopping.confirm();
      if (OVER.includes(this.status) && !OVER.includes(status) && stopping.sent === null) stopping.tell("", "");
      Object.assign(this, { status, because, events: events.length });
      this.draw();
    },

    draw() {
      const { status, because } = this, shown = pulse.silent && status !== "offline" ? "silent" : status;
      if (this.shown === shown + because) return;
      this.shown = shown + because;
      if (status === "died") {
        this.tell("The process of the walk died. What was walked is kept up to the last second; the terminal says where.");
        clearTimeout(this.timer);
      }
      for (const id of CHANGING) get(id).inert = shown === "silent" || LOST.includes(status);
      get("panel-state").dataset.state = shown;
      get("panel-state").querySelector("span").textContent =
        shown === "walking" && board.mode ? "Running" : (STATES[shown] ?? title(shown)) + (shown === status ? because : "");
      for (const button of get("panel-quick").querySelectorAll("button")) {
        button.setAttribute("aria-pressed", String(
          (button.dataset.action === "walk" && (status === "walking" || status === "waiting"))
          || (button.dataset.action === "pause" && status === "paused"),
        ));
        button.disabled = button.dataset.action !== "restart" && OVER.includes(status);
      }
    },

    frame(frame) {
      this.state(frame.status, frame.events);
      get("panel-clock").textContent = `${frame.time_s.toFixed(1)} s`;
      this.deadlines(frame.deadlines);
      board.phases(frame.phases);
      if (board.mode && frame.mode) board.mode.textContent = title(frame.mode);
    },

    deadlines(counted) {
      const kept = counted.blocks ? 100 * (1 - counted.late / counted.blocks) : 100;
      const share = kept === 100 ? "100" : Math.min(kept, 99.99).toFixed(2);
      get("panel-deadlines").textContent = `${share} % in time`;
      get("panel-deadlines").classList.toggle("poor", counted.blocks > 100 && kept < 99.9);
      board.deadlines(counted);
    },

    tell(text) {
      get("panel-message").textContent = text;
      get("panel-message").hidden = !text;
      clearTimeout(this.timer);
      if (text) this.timer = setTimeout(() => this.tell(""), 8000);
    },
  };

  // A stop is sent over the socket and, without a fast answer, also over HTTP. The page shows its confirmation.
  const stopping = {
    sent: null, // time of the first unconfirmed press

    press() {
      this.sent ??= performance.now();
      this.tell("Stop sent", "sent");
      get("stop").classList.add("pressed");
      setTimeout(() => get("stop").classList.remove("pressed"), 600);
      const otherWay = () => fetch(`/stop${location.search}`, { method: "POST" }).then((answer) => { if (answer.ok) this.confirm(); }).catch(() => {});
      const timer = setTimeout(otherWay, OTHER_WAY_AFTER);
      link.send({ kind: "do", action: "stop", values: {} }, (event) => {
        clearTimeout(timer);
        if (event?.response === "applied") this.confirm();
        else if (event) { this.sent = null; this.tell(`Stop is refused: ${event.text}`, "missing"); } else otherWay();
      });
    },

    confirm() {
      if (this.sent === null) return;
      this.tell(`Stop confirmed after ${((performance.now() - this.sent) / 1000).toFixed(2)} s`, "confirmed");
      this.sent = null;
    },

    // Show a stop that is not confirmed in time in red; called periodically.
    look(now) {
      if (this.sent === null || now - this.sent <= SILENCE) return;
      const passed = Math.max(0.5, Math.floor((now - this.sent) / 1000));
      this.tell(`Stop is not confirmed for ${passed} s. If the simulation does not answer, end it with Ctrl-C in the terminal.`, "missing");
    },

    tell(text, kind) {
      if (get("stop-state").textContent === text) return;
      get("stop-state").textContent = text;
      get("stop-state").hidden = !text;
      get("stop-state").dataset.kind = kind;
    },
  };

  // ---- heartbeat: time since the last message of the simulation -----------------------------------------

  const pulse = {
    simulation: performance.now(), // time of the last message of the simulation
    server: performance.now(), // time of the last heartbeat of the server
    looked: performance.now(),
    silent: false,

    beat(silence) {
      this.server = performance.now();
      this.simulation = this.server - 1000 * silence;
      this.look();
    },

    look() {
      const now = performance.now(), passed = now - this.simulation, stood = now - this.looked;
      this.looked = now;
      stopping.look(now);
      if (stood > SILENCE) return; // the page itself was suspended, and messages may be waiting
      // A silence alone does not invalidate a forecast: one that takes longer than the next silence would never end.
      this.silent = passed > SILENCE && !GONE.includes(head.status);
      document.body.classList.toggle("silent", this.silent);
      get("no-data").hidden = !this.silent;
      if (this.silent) this.tell(`No data for ${Math.max(0.5, Math.floor(passed / 1000))} s`, now);
      head.draw();
    },

    tell(text, now) {
      const reason = link.socket.readyState !== WebSocket.OPEN ? "The page is not connected to the program."
        : now - this.server > SILENCE ? "The program does not answer." : "The process of the simulation does not answer.";
      if (get("no-data").textContent !== text + reason) get("no-data").replaceChildren(make("strong", {}, text), make("span", {}, reason));
    },
  };

  // ---- changes: a list that is forecast and then applied -------------------------------------------------

  const changes = {
    waiting: new Map(), // {value, reverts} of every change of the list by row, in the order of the edits
    edits: [], // [row, change] that wait for their forecast; a row of null repeats the forecast of the list
    event: null, // forecast of the list; null if there is none
    refusal: "", // reason of the rejection of the list
    busy: false,
    trying: null, // row whose change is being forecast
    count: 0, // number of lists, so that an answer to an earlier list is ignored

    asks() { return get("panel-ask").querySelector("input").checked; },

    add(row, change) {
      row.refuse("");
      if (!change.reverts && change.value === row.control.value && !this.edits.length) { this.remove(row); return; }
      row.tried = change.value;
      row.show_tried(change.value);
      row.node.classList.add("pending");
      this.edits.push([row, change]);
      this.next();
    },

    // Forecasts are made one after the other, so that a rejection refers to the last edit.
    next() {
      if (this.busy || !this.edits.length) { this.draw(); return; }
      const [row, change] = this.edits.shift(), list = new Map(this.waiting), number = this.count;
      if (row) { list.delete(row); list.set(row, change); }
      if (!list.size) { this.next(); return; }
      Object.assign(this, { busy: true, trying: row });
      this.draw();
      link.send({ kind: "try", changes: this.values(list) }, (event) => {
        if (number !== this.count) return;
        const made = event?.response === "forecast", kept = row && this.trying === row;
        Object.assign(this, { busy: false, trying: null });
        if (row && !this.edits.some(([other]) => other === row)) row.node.classList.remove("pending");
        if (made) Object.assign(this, { event, refusal: "" });
        if (made && kept) { this.waiting.delete(row); this.waiting.set(row, change); }
        else if (kept) { this.back(row); row.refuse((event ?? NO_ANSWER).text); } else if (!made && !row) this.refusal = (event ?? NO_ANSWER).text;
        this.next();
      });
    },

    values(list) { return Object.fromEntries([...list].map(([row, { value, reverts }]) => [row.control.name, reverts ? null : value])); },

    // Repeat the forecast after its assumptions have changed; nothing can be applied before it ends.
    again() {
      if (!this.waiting.size && !this.busy) return;
      this.event = null;
      if (!this.edits.some(([row]) => row === null)) this.edits.push([null, null]);
      this.next();
    },

    remove(row) {
      this.edits = this.edits.filter(([other]) => other !== row);
      const listed = this.waiting.delete(row) || this.trying === row;
      if (this.trying === row) this.trying = null;
      this.back(row);
      if (!this.waiting.size && !this.edits.length && !this.busy) this.close(); else if (listed) this.again(); else this.draw();
    },

    apply() {
      const list = this.waiting, number = this.count;
      this.busy = true;
      this.draw();
      link.send({ kind: "set", changes: this.values(list) }, (event) => {
        if (number !== this.count) return;
        const applied = event?.response === "applied";
        Object.assign(this, { busy: false, event: null, refusal: applied ? "" : (event ?? NO_ANSWER).text });
        if (applied) { this.waiting = new Map(); for (const row of list.keys()) this.back(row); }
        this.next();
      });
    },

    // Set the control to its change in the list, or else to its valid value.
    back(row) {
      row.node.classList.remove("pending");
      row.tried = this.waiting.get(row)?.value;
      if (row.tried === undefined) row.show(row.control.value); else row.show_tried(row.tried);
    },

    close() {
      const rows = [...this.waiting.keys(), ...this.edits.map(([row]) => row).filter((row) => row), ...this.board_rows()];
      this.count += 1;
      Object.assign(this, { waiting: new Map(), edits: [], event: null, refusal: "", busy: false, trying: null });
      for (const row of rows) this.back(row);
      this.draw();
    },

    board_rows() { return [...board.rows.values()].filter((row) => row.tried !== undefined); },

    draw() {
      for (const row of board.rows.values()) row.node.classList.toggle("waiting", this.waiting.has(row));
      const box = get("panel-forecast"), count = this.waiting.size, settled = !this.busy && !this.edits.length;
      box.hidden = !count && settled;
      if (box.hidden) return;
      const button = (label, name, onclick, disabled) => make("button", { type: "button", dataset: { forecast: name }, onclick, disabled }, label);
      const found = settled && !this.refusal ? this.event?.forecast : null, all = count > 1 ? " all" : "";
      box.classList.toggle("bad", Boolean(this.refusal || found?.bad));
      box.replaceChildren(
        make("ul", { className: "list" }, ...[...this.waiting].map(([row, change]) => this.line(row, change))),
        make("p", { className: "comes" }, this.refusal || (found ? title(found.text) : "The forecast is being made…")),
        ...(found?.warnings ?? []).map((text) => make("p", { className: "warns" }, `Unusual: ${text}`)),
        make("p", { className: "numbers" }, found ? this.numbers(found) : ""),
        button(`Discard${all}`, "discard", () => this.close(), false),
        button(`Apply${all}${found?.bad ? " anyway" : ""}`, "apply", () => this.apply(), !found));
    },

    line(row, { value }) {
      const place = board.place(row.control), button = make("button", { type: "button", className: "remove", onclick: () => this.remove(row) }, "\u00d7");
      button.setAttribute("aria-label", `${place}: remove this change`);
      return make("li", { dataset: { change: row.control.name } },
        make("span", {}, `${place}: ${written(row.control.value, row.control)} → ${written(value, row.control)}`), button);
    },

    numbers({ rmse_deg, saturated_share }) {
      const off = Object.entries(rmse_deg).filter(([, value]) => value !== null)
        .map(([joint, value]) => `${words(joint)} ${value.toFixed(1)}°`).join(", ");
      return [`As of ${(this.event.tick / 1000).toFixed(1)} s`, off && `RMS off the reference: ${off}`,
        `worst joint at a limit ${(100 * saturated_share).toFixed(1)} % of the time`].filter(Boolean).join("; ");
    },
  };

  // ---- a control ------------------------------------------------------------------------------------

  // Row of a control: label, input of the value, button that reverts to the preset, and a line for a rejection.
  class Row {
    constructor(control, setter) {
      this.control = control;
      this.setter = setter; // null for a field of an action, because its value is sent with the action
      this.id = `control-${control.name.replace(/[^\w]/g, "-")}${setter ? "" : "-field"}`;
      this.refusal = make("p", { className: "refusal", id: `${this.id}-refusal`, hidden: true, role: "alert" });
      this.input = this.entry();
      const side = control.side && control.group === "table" ? `${title(control.side)} ` : "";
      const label = make("label", { htmlFor: this.id, title: control.help }, side, title(control.label || control.name));
      if (control.unit) label.append(" ", make("span", { className: "unit" }, unit(control.unit)));
      this.node = make("div", { className: `control ${control.kind}`, dataset: { control: control.name } }, label, this.input);
      if (setter) this.node.append(this.revert = this.back());
      this.node.append(this.refusal);
      this.show(control.value);
    }

    entry() {
      if (this.control.kind === "number") return this.number();
      if (this.control.kind === "choice") return this.choice();
      if (this.control.kind === "switch") return this.switch();
      this.box = make("input", { type: "text", id: this.id, maxLength: 200, spellcheck: false });
      this.box.onchange = () => this.set(this.box.value);
      return this.box;
    }

    number() {
      const { minimum, maximum, step } = this.control;
      this.box = make("input", {
        type: "number", id: this.id, step: "any", inputMode: "decimal", autocomplete: "off",
        title: minimum === null ? "" : `${written(minimum, this.control)} to ${written(maximum, this.control)}`,
      });
      this.box.setAttribute("aria-describedby", this.refusal.id);
      this.box.onchange = () => this.typed();
      const parts = [];
      const nudge = (sign, text) => make("button", {
        type: "button", className: "nudge", dataset: { nudge: String(sign) },
        title: `${written(step, this.control)} ${sign < 0 ? "less" : "more"}`,
        onclick: () => this.set(Number(((this.tried ?? this.held) + sign * step).toFixed(9))),
      }, text);
      if (this.control.group === "monitor" && step) parts.push(nudge(-1, "\u2212"), this.box, nudge(1, "+"));
      else parts.push(this.box);
      if (minimum !== null && maximum !== null) {
        this.slider = make("input", { type: "range", min: minimum, max: maximum, step: step ?? "any", tabIndex: 0 });
        this.slider.setAttribute("aria-label", `${this.control.label || this.control.name}, slider`);
        // A mark shows the value of the preset.
        const mark = make("datalist", { id: `${this.id}-preset` }, make("option", { value: this.control.default }));
        this.slider.setAttribute("list", mark.id);
        parts.push(mark);
        this.slider.oninput = () => { this.dragging = true; this.box.value = Number(this.slider.value).toFixed(decimals(step)); };
        this.slider.onchange = () => { this.dragging = false; this.set(Number(this.slider.value)); };
        parts.unshift(this.slider);
      }
      return make("div", { className: "number" }, ...parts);
    }

    choice() {
      this.box = make("select", { id: this.id });
      this.offer(this.control.choices);
      this.box.onchange = () => this.set(this.box.value);
      return this.box;
    }

    // Set the options of a choice; a selected option is kept if it still exists.
    offer(names) {
      const chosen = this.box.value;
      this.box.replaceChildren(...names.map((name) => make("option", { value: name }, name ? title(name) : "–")));
      if (names.includes(chosen)) this.box.value = chosen;
      this.box.disabled = names.length < 2;
    }

    switch() {
      this.box = make("input", { type: "checkbox", id: this.id, role: "switch" });
      this.box.onchange = () => this.set(this.box.checked);
      return this.box;
    }

    back() {
      const button = make("button", { type: "button", className: "back" }, "↺");
      button.onclick = () => this.change({ value: this.control.default, reverts: true }, (answer) => link.send(
        { kind: "do", action: "revert", values: { control: this.control.name } }, answer));
      button.setAttribute("aria-label", `${this.control.label || this.control.name}: back to the preset`);
      return button;
    }

    // Return whether the user is editing the value and has not sent it.
    typing() { return document.activeElement === this.box && this.box.value !== this.shown; }

    // Send a typed number. Text that is not a number is sent unchanged, and the simulation returns the error.
    typed() {
      const text = this.box.value.trim();
      if (text === "") this.show(this.held);
      else this.set(Number.isFinite(Number(text)) ? Number(text) : text);
    }

    value() {
      if (this.control.kind === "number") return this.box.value.trim() === "" ? "" : Number(this.box.value);
      return this.control.kind === "switch" ? this.box.checked : this.box.value;
    }

    set(value) {
      if (!this.setter) { if (this.control.kind === "number") this.show(value); return; }
      this.change({ value, reverts: false }, (answer) => this.setter(value, answer));
    }

    // Apply a change immediately, or add it to the list of waiting changes.
    change(change, send) {
      if (changes.asks()) { changes.add(this, change); return; }
      if (this.tried !== undefined) changes.remove(this);
      this.ask(send);
    }

    show_tried(value) {
      if (this.control.kind === "switch") this.box.checked = Boolean(value);
      else if (this.control.kind === "choice") this.box.value = value;
      else if (this.control.kind === "number" && typeof value === "number") {
        this.box.value = value.toFixed(decimals(this.control.step));
        if (this.slider) this.slider.value = value;
      }
    }

    // Send the value, and show the result: the new value, or the old one and the reason.
    ask(send) {
      this.node.classList.add("pending");
      this.refuse("");
      send((event) => {
        const told = event ?? NO_ANSWER;
        this.node.classList.remove("pending");
        if (told.response !== "applied") this.refuse(told.text);
        else if (told.value !== null) this.control.value = told.value;
        this.show(this.control.value);
      });
    }

    take(control) {
      this.control = control;
      const busy = this.node.classList.contains("pending") || this.tried !== undefined;
      if (!busy && !this.dragging && !this.typing()) this.show(control.value);
      this.mark();
    }

    show(value) {
      this.held = value;
      if (this.control.kind === "switch") this.box.checked = Boolean(value);
      else if (this.control.kind === "number") {
        this.box.value = value.toFixed(decimals(this.control.step));
        if (this.slider) this.slider.value = value;
      } else this.box.value = value;
      this.shown = this.box.value;
      this.mark();
    }

    mark() {
      const changed = this.setter && this.control.changed;
      this.node.classList.toggle("changed", Boolean(changed));
      if (!this.revert) return;
      this.revert.disabled = !changed;
      this.revert.title = `Preset: ${written(this.control.default, this.control)}`;
    }

    refuse(text) {
      this.refusal.textContent = text;
      this.refusal.hidden = !text;
    }
  }

  // ---- an action and its fields -----------------------------------------------------------------------

  class Deed {
    constructor(spec) {
      this.spec = spec;
      this.fields = spec.fields.map((field) => new Row(field, null));
      this.button = make("button", { type: "button", dataset: { action: spec.action }, title: spec.help }, title(spec.label));
      this.button.onclick = () => this.do();
      this.answer = make("p", { className: "refusal", hidden: true, role: "alert" });
      this.node = make("fieldset", { className: "deed" }, make("legend", {}, title(spec.label)),
        spec.help ? make("p", { className: "help" }, spec.help) : "", ...this.fields.map((row) => row.node), this.button, this.answer);
      this.node.classList.toggle("plain", !spec.fields.length);
      for (const row of this.fields) {
        const other = this.fields.find((one) => one.control.name === row.control.depends_on);
        const offer = () => row.offer(row.control.choices_by_value[other.value()]);
        if (other) { other.box.addEventListener("change", offer); offer(); }
      }
    }

    do() {
      const values = Object.fromEntries(this.fields.map((row) => [row.control.name, row.value()]));
      this.button.classList.add("pending");
      this.say("");
      link.send({ kind: "do", action: this.spec.action, values }, (event) => {
        this.button.classList.remove("pending");
        const told = event ?? NO_ANSWER;
        if (told.response === "applied") this.say(told.text, "done"); else this.say(told.text);
      });
    }

    say(text, kind = "") {
      const quick = QUICK.includes(this.spec.action);
      if (quick) { if (kind !== "done") head.tell(text); return; }
      this.answer.textContent = text;
      this.answer.hidden = !text;
      this.answer.classList.toggle("done", kind === "done");
    }
  }

  // ---- all controls ---------------------------------------------------------------------------------

  const board = {
    rows: new Map(),
    deeds: new Map(),
    state: null,
    colours: new Map(), // colours of the phases by name
    phase: null,
    joint: null,

    take(state) {
      const same = this.state && this.state.experiment === state.experiment
        && this.state.controls.length === state.controls.length;
      const changed = same && state.controls.some((control, index) => control.value !== this.state.controls[index].value);
      this.state = state;
      if (!same) this.build();
      for (const control of state.controls) this.rows.get(control.name)?.take(control);
      this.compare();
      if (changed) changes.again();
    },

    build() {
      changes.close();
      this.rows.clear();
      this.deeds.clear();
      tabs.clear();
      for (const control of this.state.controls) {
        this.rows.set(control.name, new Row(control, (value, answer) =>
          link.send({ kind: "set", control: control.name, value }, answer)));
      }
      for (const spec of this.state.actions) this.deeds.set(spec.action, new Deed(spec));
      head.shown = null;
      get("panel-quick").replaceChildren(...QUICK.filter((name) => this.deeds.has(name)).map((name) => this.deeds.get(name).button));
      this.requests(this.deeds.get("request")?.spec);
      this.table();
      this.monitor();
      for (const control of this.state.controls) {
        if (!["table", "monitor"].includes(control.group)) tabs.body(control.group).append(this.rows.get(control.name).node);
      }
      for (const [name, deed] of this.deeds) {
        if (!APART.includes(name)) tabs.body(PLACES[name] ?? deed.spec.group).append(deed.node);
      }
      tabs.body("walk").append(this.statistics = make("dl", { id: "panel-statistics" }));
    },

    // Make a button for every mode that can be requested, after the present mode.
    requests(spec) {
      get("panel-requests").hidden = !spec;
      if (!spec) return;
      this.mode = make("strong", {});
      const ask = (name) => link.send({ kind: "do", action: "request", values: { request: name } }, (event) => {
        const told = event ?? NO_ANSWER;
        head.tell(told.response === "applied" ? "" : `${title(name)} is refused: ${words(told.text)}`);
      });
      get("panel-requests").replaceChildren(make("p", { title: spec.help }, "Mode ", this.mode),
        ...spec.fields[0].choices.map((name) => make("button", { type: "button", dataset: { request: name }, onclick: () => ask(name) }, title(name))));
    },

    // Draw the table, one phase at a time: chips for the phases, one column for each joint.
    table() {
      this.chips = new Map(this.state.phases.map((name) => {
        const chip = make("button", { type: "button", className: "chip", dataset: { phase: name } },
          make("span", { className: "name" }, title(name)), make("i", { className: "dot" }), make("span", { className: "where" }));
        chip.style.setProperty("--phase", this.colours.get(name)?.colour ?? "#7f7f7f");
        chip.onclick = () => this.choose(name);
        return [name, chip];
      }));
      this.sheets = new Map(this.state.phases.map((name) => [name, this.sheet(name)]));
      this.differences = make("div", { id: "panel-differences" });
      tabs.body("table").append(
        make("div", { className: "chips", role: "group", aria: { label: "Phase of gait" } }, ...this.chips.values()),
        ...this.sheets.values(), this.differences);
      this.choose(this.state.phases.includes(this.phase) ? this.phase : this.state.phases[0]);
    },

    sheet(phase) {
      const columns = this.state.joints.map((joint) => make("section", {}, make("h3", {}, title(joint)),
        ...this.state.controls.filter((one) => one.phase === phase && one.joint === joint).map((one) => this.rows.get(one.name).node)));
      return make("div", { className: "sheet", dataset: { phase } }, ...columns);
    },

    // Draw the monitor, one joint at a time: the controller of the joints, and a section for each of the controls.
    monitor() {
      const own = this.state.controls.filter((one) => one.group === "monitor");
      const joints = [...new Set(own.filter((one) => one.joint).map((one) => `${one.side} ${one.joint}`))];
      const quantity = (one) => one.name.split(".").pop();
      this.joints = new Map(joints.map((name) => {
        const chip = make("button", { type: "button", className: "chip plain", dataset: { joint: name } }, title(name), make("i", { className: "dot" }));
        chip.onclick = () => this.choose_joint(name);
        const sheet = make("div", { className: "controls-of-joint" }, ...MONITOR.map(([mode, label, quantities]) => {
          const rows = quantities.flatMap((what) => own.filter((one) => `${one.side} ${one.joint}` === name && quantity(one) === what));
          return make("section", { className: "monitor", dataset: { mode } }, make("h3", {}, label), ...rows.map((one) => this.rows.get(one.name).node));
        }));
        return [name, { chip, sheet }];
      }));
      const loose = own.filter((one) => !one.joint).map((one) => this.rows.get(one.name).node);
      const parts = [...this.joints.values()];
      tabs.body("monitor").append(...loose, make("div", {
        className: "chips of-joints", style: { "--columns": joints.length > 4 ? 3 : 4 }, role: "group", aria: { label: "Joint" },
      },
        ...parts.map((part) => part.chip)), ...parts.map((part) => part.sheet));
      this.choose_joint(joints.includes(this.joint) ? this.joint : joints[0]);
    },

    choose_joint(joint) {
      this.joint = joint;
      for (const [name, { chip, sheet }] of this.joints) {
        chip.setAttribute("aria-pressed", String(name === joint));
        sheet.hidden = name !== joint;
      }
    },

    choose(phase) {
      this.phase = phase;
      for (const [name, chip] of this.chips) chip.setAttribute("aria-pressed", String(name === phase));
      for (const [name, sheet] of this.sheets) sheet.hidden = name !== phase;
    },

    phases(present) {
      if (!this.chips || !present) return;
      for (const [name, chip] of this.chips) {
        const text = Object.entries(present).filter(([, phase]) => phase === name).map(([side]) => side[0].toUpperCase()).join("");
        const mark = chip.querySelector(".where");
        if (mark.textContent !== text) mark.textContent = text;
      }
    },

    compare() {
      const changed = this.state.controls.filter((one) => one.changed);
      for (const [name, chip] of this.chips) chip.classList.toggle("changed", changed.some((one) => one.phase === name));
      for (const [name, { chip }] of this.joints) chip.classList.toggle("changed", changed.some((one) => `${one.side} ${one.joint}` === name && one.group === "monitor"));
      const mode = this.state.controls.find((one) => one.name === "mode")?.value;
      for (const section of document.querySelectorAll(".monitor")) section.classList.toggle("active", section.dataset.mode === mode);
      this.differences.replaceChildren(make("h3", {}, changed.length ? `Changed from the preset: ${changed.length}` : "As in the preset"));
      if (!changed.length) return;
      const table = make("table", {});
      table.createTHead().append(make("tr", {}, ...["", "Preset", "Now", ""].map((text) => make("th", {}, text))));
      table.createTBody().append(...changed.map((one) => this.difference(one)));
      this.differences.append(make("div", { className: "scroll" }, table));
      if (this.deeds.has("revert")) this.differences.append(this.revert_all());
    },

    // Return the position of a control on the page as text.
    place(one) {
      const place = [one.phase && title(one.phase), one.side, one.joint].filter(Boolean).map(words).join(" ");
      return place ? `${title(place)}: ${one.label.replace("θ0", "θ₀")}` : title(one.label);
    },

    difference(one) {
      const place = this.place(one);
      const back = make("button", { type: "button", className: "back", title: "Back to the preset" }, "↺");
      back.setAttribute("aria-label", `${place}: back to the preset`);
      back.onclick = () => this.rows.get(one.name).revert.click();
      return make("tr", { dataset: { difference: one.name } },
        make("td", {}, place),
        make("td", {}, written(one.default, one)), make("td", {}, written(one.value, one)), make("td", {}, back));
    },

    revert_all() {
      const button = make("button", { type: "button", id: "revert-all" }, "Revert all");
      const answer = make("p", { className: "refusal", role: "alert", hidden: true });
      button.onclick = () => link.send({ kind: "do", action: "revert", values: { control: "all" } }, (event) => {
        const told = event ?? NO_ANSWER;
        answer.textContent = told.text;
        answer.hidden = told.response === "applied";
      });
      return make("div", {}, button, answer);
    },

    deadlines(counted) {
      if (!this.statistics) return;
      const entries = [
        ["Blocks of 10 ms", String(counted.blocks)], ["Late by more than 10 ms", String(counted.late)],
        ["Worst", `${counted.worst_ms.toFixed(1)} ms`], ["Time given up", `${counted.lost_s.toFixed(2)} s`],
      ];
      if (this.statistics.childElementCount !== entries.length) {
        this.statistics.replaceChildren(...entries.map(([name]) => make("div", {}, make("dt", {}, name), make("dd", {}))));
      }
      this.statistics.querySelectorAll("dd").forEach((cell, index) => { cell.textContent = entries[index][1]; });
    },
  };

  // ---- tabs -----------------------------------------------------------------------------------------

  const tabs = {
    build() {
      for (const [name, label] of TABS) {
        const tab = make("button", { type: "button", id: `tab-${name}`, role: "tab", aria: { controls: `body-${name}` } }, label);
        tab.onclick = () => this.open(name);
        get("panel-tabs").append(tab);
        get("panel-body").append(make("section", { id: `body-${name}`, role: "tabpanel", tabIndex: -1, aria: { labelledby: tab.id } }));
      }
      get("panel-tabs").addEventListener("keydown", (event) => this.key(event));
      this.open("walk");
    },

    body(group) { return get(`body-${HOMES[group] ?? group}`) ?? get("body-walk"); },

    clear() { for (const [name] of TABS) if (name !== "log") get(`body-${name}`).replaceChildren(); },

    open(name) {
      for (const [one] of TABS) {
        get(`tab-${one}`).setAttribute("aria-selected", String(one === name));
        get(`tab-${one}`).tabIndex = one === name ? 0 : -1;
        get(`body-${one}`).hidden = one !== name;
      }
    },

    key(event) {
      const names = TABS.map(([name]) => name), now = names.findIndex((name) => `tab-${name}` === document.activeElement.id);
      const next = { ArrowRight: now + 1, ArrowLeft: now - 1, Home: 0, End: names.length - 1 }[event.key];
      if (now < 0 || next === undefined) return;
      const name = names[(next + names.length) % names.length];
      this.open(name);
      get(`tab-${name}`).focus();
      event.preventDefault();
      event.stopPropagation();
    },
  };

  // ---- log ------------------------------------------------------------------------------------------

  const log = {
    seen: new Set(),
    session: null,

    // Another session restarts the serial numbers and has its own log.
    open(session) {
      if (this.session === session) return;
      this.session = session;
      this.seen.clear();
      this.walks = 1;
      changes.close();
      get("body-log").replaceChildren();
    },

    walks: 1,

    // Insert a line in the order of the walks and their ticks, the newest first.
    add(event) {
      if (event.serial) { if (this.seen.has(event.serial)) return; this.seen.add(event.serial); }
      const body = get("body-log");
      if (!body.querySelector("ol")) body.append(make("ol", { id: "panel-log", reversed: true }));
      const line = make("li", { className: event.response, dataset: { tick: String(event.tick), response: event.response } },
        make("time", {}, `${(event.tick / 1000).toFixed(3)} s`),
        make("span", { className: "what" }, event.text),
        make("small", {}, [`tick ${event.tick}`, event.user, ["refused", "forecast"].includes(event.response) ? event.response : ""].filter(Boolean).join(" · ")));
      if (event.subject === "restart" && event.response === "applied") this.walks += 1;
      const list = body.querySelector("ol"), { walks: walk } = this, { tick } = event;
      Object.assign(line, { walk, tick });
      const before = [...list.children].find((other) => other.walk < walk || (other.walk === walk && other.tick <= tick));
      list.insertBefore(line, before ?? null);
      while (list.childElementCount > LOG_LINES) list.lastElementChild.remove();
    },
  };

  // ---- start ----------------------------------------------------------------------------------------

  tabs.build();
  get("stop").onclick = () => stopping.press();
  // The key is handled before all other handlers of the page, independently of the focus.
  window.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) stopping.press();
  }, true);
  // On a low or narrow page the curves are below the numbers, and the page ends above the foot of the panel.
  const measure = (node, name, edge) => new ResizeObserver(() => document.body.style.setProperty(name, `${node.getBoundingClientRect()[edge]}px`)).observe(node);
  measure(twinGait.stage.head, "--head-end", "bottom");
  measure(get("panel-foot"), "--foot", "height");
  link.open();
  view.open();
  setInterval(() => pulse.look(), LOOK);
  window.livePanel = { link, board, log, head, view, stopping, pulse, changes };
})();
