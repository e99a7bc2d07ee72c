// Panel of the live page. It draws the controls that the simulation declares, sends changes and shows their
// results. The reason of a rejection is next to its control, which returns to the valid value.
// Messages are defined in twin_gait/live/protocol.py; a batch of messages is one list.
"use strict";

(() => {
  const get = (id) => document.getElementById(id);
  const TABS = [["walk", "Walk"], ["table", "Table"], ["monitor", "Monitor"], ["disturb", "Push & faults"], ["log", "Log"]];
  const TAB_OF_GROUP = { push: "disturb", fault: "disturb" }; // tab of a group that does not have its own tab
  const TAB_OF_ACTION = { push: "disturb", fault: "disturb", save: "table" }; // tab of an action, if not that of its group
  const ALWAYS_VISIBLE = ["walk", "pause", "step", "restart"]; // actions above the tabs
  const NOT_IN_TABS = [...ALWAYS_VISIBLE, "request", "stop", "revert"]; // actions with their own position
  const STATES = {
    walking: "Walking", paused: "Paused", waiting: "Waiting for a step", held: "HOLD",
    fell: "Fell", diverged: "Diverged", ended: "Ended", died: "Aborted: the process of the simulation has ended",
    no_data: "No data", offline: "Not connected", connecting: "Connecting…",
  };
  // The three controls of the monitor, each with its quantities.
  const MONITOR = [
    ["friction_control", "Friction control", ["gain"]], ["torque_control", "Torque control", ["torque"]],
    ["impedance_control", "Impedance control", ["stiffness", "equilibrium", "damping"]],
  ];
  const FINISHED = ["held", "fell", "diverged", "ended", "died"]; // states that only a restart can leave
  const REPORTABLE = ["held", "fell", "diverged", "paused"]; // states in which the report of the session is offered
  const WITHOUT_PROCESS = ["ended", "died"]; // states without a process of the simulation
  const UNAVAILABLE = ["connecting", "offline", ...WITHOUT_PROCESS]; // states in which nothing can be changed
  // Parts of the page that change something, without the emergency stop.
  const CHANGING = ["panel-quick", "panel-requests", "panel-forecast", "panel-forecast-first", "body-walk", "body-table", "body-monitor", "body-disturb"];
  const TIMEOUT = 500, CHECK_PERIOD = 100; // [ms]
  const HTTP_AFTER = 250; // [ms], time without a reply after which a stop is also sent over HTTP
  const REPLY_TIMEOUT = 130000; // [ms]; long, because a restart first writes the run of the walk
  const LOG_LINES = 400;
  const REGULAR_FRAME = 34, LONGEST_PAUSE = 400; // [ms]
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

  function format_value(value, control) {
    if (typeof value === "boolean") return value ? "on" : "off";
    if (typeof value !== "number") return words(String(value));
    const text = value.toFixed(decimals(control?.step)).replace("-", "\u2212");
    return control?.unit ? `${text} ${control.unit}` : text;
  }

  // ---- connection -----------------------------------------------------------------------------------

  const link = {
    socket: null,
    count: 0,
    waiting: new Map(), // handler of the reply by the id of the message

    open() {
      this.socket = new WebSocket(`ws://${location.host}/panel${location.search}`);
      this.socket.onmessage = (message) => { for (const item of JSON.parse(message.data)) receive(item); };
      this.socket.onopen = () => get("panel").classList.remove("offline");
      this.socket.onclose = () => {
        get("panel").classList.add("offline");
        if (!WITHOUT_PROCESS.includes(head.status)) head.set_state("offline");
        for (const handler of this.waiting.values()) handler(null);
        this.waiting.clear();
        setTimeout(() => this.open(), 1000);
      };
    },

    // Send a message; `handler` is called with the event that has its id, or with null after a timeout.
    send(message, handler) {
      const id = `${page}-${this.count += 1}`;
      if (this.socket?.readyState !== WebSocket.OPEN) { handler(null); return; }
      this.waiting.set(id, handler);
      setTimeout(() => { if (this.waiting.delete(id)) handler(null); }, REPLY_TIMEOUT);
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
      twinGait.stage.visible_area = visible_area;
      this.connect();
    },

    connect() {
      const socket = new WebSocket(`ws://${location.host}/socket${location.search}`);
      socket.binaryType = "arraybuffer";
      socket.onmessage = (message) => {
        twinGait.receive(new Uint8Array(message.data));
        twinGait.show(...this.samples.splice(0));
        this.acknowledge(socket, performance.now());
      };
      socket.onclose = () => setTimeout(() => this.connect(), 1000);
    },

    // Without a graphics card drawing is slow; the page then waits for as long as it has drawn, so that the
    // simulation has enough processor time.
    acknowledge(socket, start) {
      requestAnimationFrame(() => {
        const pause = Math.min(Math.max(performance.now() - start - REGULAR_FRAME, 0), LONGEST_PAUSE);
        setTimeout(() => { if (socket.readyState === WebSocket.OPEN) socket.send("drawn"); }, pause);
      });
    },
  };

  // Compute the part of the pane that no card covers: between the numbers and the panel.
  function visible_area() {
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

  const NO_REPLY = { response: "refused", text: "no reply from the simulation" };

  function receive(message) {
    if (message.kind === "page") { log.open(message.session); head.reports = message.report; }
    if (message.kind === "page") board.colours = new Map(message.phases.map((phase) => [phase.name, phase]));
    else if (message.kind === "state") board.update(message);
    else if (message.kind === "frame") head.frame(message);
    else if (message.kind === "heartbeat") heartbeat.receive(message.time_since_message_s);
    else if (message.kind === "event") {
      log.add(message);
      const handler = link.waiting.get(message.id);
      if (handler && link.waiting.delete(message.id)) handler(message);
      else if (message.response === "refused" && message.subject === "") head.show_message(message.text);
    }
  }

  // ---- head: state of the walk, actions that are always visible, stop ----------------------------------

  const head = {
    status: "connecting",
    events: 0, // number of faults, trips and falls of the walk
    reports: false, // whether the session has a report

    // Show the state, with the cause and the joint of a trip, which follow the colon of its text.
    set_state(status, events = []) {
      const trip = events.find((event) => event.kind === "trip")?.text.split(": ")[1];
      const cause = trip && ["held", "fell"].includes(status) ? `: ${status === "fell" ? "after a hold, " : ""}${trip}` : "";
      const differs = [FINISHED, UNAVAILABLE].some((list) => list.includes(this.status) !== list.includes(status));
      if (differs || this.events !== events.length) changes.repeat_forecast();
      if (["held", "fell"].includes(status) && status !== this.status) stopping.confirm();
      if (FINISHED.includes(this.status) && !FINISHED.includes(status) && stopping.sent === null) stopping.show_message("", "");
      Object.assign(this, { status, cause, events: events.length });
      this.draw();
    },

    draw() {
      const { status, cause } = this, shown = heartbeat.timed_out && status !== "offline" ? "no_data" : status;
      if (this.shown === shown + cause) return;
      this.shown = shown + cause;
      if (status === "died") {
        this.show_message("The process of the simulation has ended. The walk is saved up to the last second; the terminal prints the folder.");
        clearTimeout(this.timer);
      }
      for (const id of CHANGING) get(id).inert = shown === "no_data" || UNAVAILABLE.includes(status);
      get("session-report").hidden = !this.reports || !REPORTABLE.includes(shown);
      get("panel-state").dataset.state = shown;
      get("panel-state").querySelector("span").textContent =
        shown === "walking" && board.mode ? "Running" : (STATES[shown] ?? title(shown)) + (shown === status ? cause : "");
      for (const button of get("panel-quick").querySelectorAll("button")) {
        button.setAttribute("aria-pressed", String(
          (button.dataset.action === "walk" && (status === "walking" || status === "waiting"))
          || (button.dataset.action === "pause" && status === "paused"),
        ));
        button.disabled = button.dataset.action !== "restart" && FINISHED.includes(status);
      }
    },

    frame(frame) {
      this.set_state(frame.status, frame.events);
      get("panel-clock").textContent = `${frame.time_s.toFixed(1)} s`;
      this.deadlines(frame.deadlines);
      board.phases(frame.phases);
      if (board.mode && frame.mode) board.mode.textContent = title(frame.mode);
    },

    deadlines(counts) {
      const in_time = counts.blocks ? 100 * (1 - counts.late / counts.blocks) : 100;
      const share = in_time === 100 ? "100" : Math.min(in_time, 99.99).toFixed(2);
      get("panel-deadlines").textContent = `${share} % in time`;
      get("panel-deadlines").classList.toggle("poor", counts.blocks > 100 && in_time < 99.9);
      board.deadlines(counts);
    },

    show_message(text) {
      get("panel-message").textContent = text;
      get("panel-message").hidden = !text;
      clearTimeout(this.timer);
      if (text) this.timer = setTimeout(() => this.show_message(""), 8000);
    },
  };

  // A stop is sent over the socket and, without a fast reply, also over HTTP. The page shows its confirmation.
  const stopping = {
    sent: null, // time of the first unconfirmed press

    press() {
      this.sent ??= performance.now();
      this.show_message("Stop sent", "sent");
      get("stop").classList.add("pressed");
      setTimeout(() => get("stop").classList.remove("pressed"), 600);
      const send_over_http = () => fetch(`/stop${location.search}`, { method: "POST" }).then((reply) => { if (reply.ok) this.confirm(); }).catch(() => {});
      const timer = setTimeout(send_over_http, HTTP_AFTER);
      link.send({ kind: "do", action: "stop", values: {} }, (event) => {
        clearTimeout(timer);
        if (event?.response === "applied") this.confirm();
        else if (event) { this.sent = null; this.show_message(`Stop was rejected: ${event.text}`, "missing"); } else send_over_http();
      });
    },

    confirm() {
      if (this.sent === null) return;
      this.show_message(`Stop confirmed after ${((performance.now() - this.sent) / 1000).toFixed(2)} s`, "confirmed");
      this.sent = null;
    },

    // Show a stop that is not confirmed in time in red; called periodically.
    check(now) {
      if (this.sent === null || now - this.sent <= TIMEOUT) return;
      const passed = Math.max(0.5, Math.floor((now - this.sent) / 1000));
      this.show_message(`Stop has not been confirmed for ${passed} s. If the simulation does not respond, end it with Ctrl-C in the terminal.`, "missing");
    },

    show_message(text, kind) {
      if (get("stop-state").textContent === text) return;
      get("stop-state").textContent = text;
      get("stop-state").hidden = !text;
      get("stop-state").dataset.kind = kind;
    },
  };

  // ---- heartbeat: time since the last message of the simulation -----------------------------------------

  const heartbeat = {
    simulation: performance.now(), // time of the last message of the simulation
    server: performance.now(), // time of the last heartbeat of the server
    checked: performance.now(), // time of the last check
    timed_out: false,

    receive(time_since_message) {
      this.server = performance.now();
      this.simulation = this.server - 1000 * time_since_message;
      this.check();
    },

    check() {
      const now = performance.now(), passed = now - this.simulation, suspended = now - this.checked;
      this.checked = now;
      stopping.check(now);
      if (suspended > TIMEOUT) return; // the page itself was suspended, and messages may be waiting
      // A timeout alone does not invalidate a forecast: one that takes longer than the time to the next timeout would never end.
      this.timed_out = passed > TIMEOUT && !WITHOUT_PROCESS.includes(head.status);
      document.body.classList.toggle("without-data", this.timed_out);
      get("no-data").hidden = !this.timed_out;
      if (this.timed_out) this.show_message(`No data for ${Math.max(0.5, Math.floor(passed / 1000))} s`, now);
      head.draw();
    },

    show_message(text, now) {
      const reason = link.socket.readyState !== WebSocket.OPEN ? "The page is not connected to the program."
        : now - this.server > TIMEOUT ? "The program does not respond." : "The process of the simulation does not respond.";
      if (get("no-data").textContent !== text + reason) get("no-data").replaceChildren(make("strong", {}, text), make("span", {}, reason));
    },
  };

  // ---- changes: a list that is forecast and then applied -------------------------------------------------

  const changes = {
    waiting: new Map(), // {value, reverts} of every change of the list by row, in the order of the edits
    edits: [], // [row, change] that wait for their forecast; a row of null repeats the forecast of the list
    event: null, // forecast of the list; null if there is none
    rejection: "", // reason of the rejection of the list
    busy: false,
    current: null, // row whose change is being forecast
    count: 0, // number of lists, so that a reply to an earlier list is ignored

    forecasts_first() { return get("panel-forecast-first").querySelector("input").checked; },

    add(row, change) {
      row.show_rejection("");
      if (!change.reverts && change.value === row.control.value && !this.edits.length) { this.remove(row); return; }
      row.pending_value = change.value;
      row.show_pending(change.value);
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
      Object.assign(this, { busy: true, current: row });
      this.draw();
      link.send({ kind: "try", changes: this.values(list) }, (event) => {
        if (number !== this.count) return;
        const made = event?.response === "forecast", kept = row && this.current === row;
        Object.assign(this, { busy: false, current: null });
        if (row && !this.edits.some(([other]) => other === row)) row.node.classList.remove("pending");
        if (made) Object.assign(this, { event, rejection: "" });
        if (made && kept) { this.waiting.delete(row); this.waiting.set(row, change); }
        else if (kept) { this.restore(row); row.show_rejection((event ?? NO_REPLY).text); } else if (!made && !row) this.rejection = (event ?? NO_REPLY).text;
        this.next();
      });
    },

    values(list) { return Object.fromEntries([...list].map(([row, { value, reverts }]) => [row.control.name, reverts ? null : value])); },

    // Repeat the forecast after its assumptions have changed; nothing can be applied before it ends.
    repeat_forecast() {
      if (!this.waiting.size && !this.busy) return;
      this.event = null;
      if (!this.edits.some(([row]) => row === null)) this.edits.push([null, null]);
      this.next();
    },

    remove(row) {
      this.edits = this.edits.filter(([other]) => other !== row);
      const listed = this.waiting.delete(row) || this.current === row;
      if (this.current === row) this.current = null;
      this.restore(row);
      if (!this.waiting.size && !this.edits.length && !this.busy) this.close(); else if (listed) this.repeat_forecast(); else this.draw();
    },

    apply() {
      const list = this.waiting, number = this.count;
      this.busy = true;
      this.draw();
      link.send({ kind: "set", changes: this.values(list) }, (event) => {
        if (number !== this.count) return;
        const applied = event?.response === "applied";
        Object.assign(this, { busy: false, event: null, rejection: applied ? "" : (event ?? NO_REPLY).text });
        if (applied) { this.waiting = new Map(); for (const row of list.keys()) this.restore(row); }
        this.next();
      });
    },

    // Set the control to its change in the list, or else to its valid value.
    restore(row) {
      row.node.classList.remove("pending");
      row.pending_value = this.waiting.get(row)?.value;
      if (row.pending_value === undefined) row.show(row.control.value); else row.show_pending(row.pending_value);
    },

    close() {
      const rows = [...this.waiting.keys(), ...this.edits.map(([row]) => row).filter((row) => row), ...this.pending_rows()];
      this.count += 1;
      Object.assign(this, { waiting: new Map(), edits: [], event: null, rejection: "", busy: false, current: null });
      for (const row of rows) this.restore(row);
      this.draw();
    },

    pending_rows() { return [...board.rows.values()].filter((row) => row.pending_value !== undefined); },

    draw() {
      for (const row of board.rows.values()) row.node.classList.toggle("waiting", this.waiting.has(row));
      const box = get("panel-forecast"), count = this.waiting.size, settled = !this.busy && !this.edits.length;
      box.hidden = !count && settled;
      if (box.hidden) return;
      const button = (label, name, onclick, disabled) => make("button", { type: "button", dataset: { forecast: name }, onclick, disabled }, label);
      const found = settled && !this.rejection ? this.event?.forecast : null, all = count > 1 ? " all" : "";
      box.classList.toggle("bad", Boolean(this.rejection || found?.bad));
      box.replaceChildren(
        make("ul", { className: "list" }, ...[...this.waiting].map(([row, change]) => this.line(row, change))),
        make("p", { className: "result" }, this.rejection || (found ? title(found.text) : "The forecast is being computed…")),
        ...(found?.warnings ?? []).map((text) => make("p", { className: "warning" }, `Unusual: ${text}`)),
        make("p", { className: "numbers" }, found ? this.numbers(found) : ""),
        button(`Discard${all}`, "discard", () => this.close(), false),
        button(`Apply${all}${found?.bad ? " anyway" : ""}`, "apply", () => this.apply(), !found));
    },

    line(row, { value }) {
      const name = board.full_name(row.control), button = make("button", { type: "button", className: "remove", onclick: () => this.remove(row) }, "\u00d7");
      button.setAttribute("aria-label", `${name}: remove this change`);
      return make("li", { dataset: { change: row.control.name } },
        make("span", {}, `${name}: ${format_value(row.control.value, row.control)} → ${format_value(value, row.control)}`), button);
    },

    numbers({ rmse_deg, saturated_share }) {
      const errors = Object.entries(rmse_deg).filter(([, value]) => value !== null)
        .map(([joint, value]) => `${words(joint)} ${value.toFixed(1)}°`).join(", ");
      return [`Forecast made at ${(this.event.tick / 1000).toFixed(1)} s`, errors && `RMS error against healthy gait: ${errors}`,
        `worst joint at a motor limit for ${(100 * saturated_share).toFixed(1)} % of the time`].filter(Boolean).join("; ");
    },
  };

  // ---- a control ------------------------------------------------------------------------------------

  // Row of a control: label, input of the value, button that reverts to the preset, and a line for a rejection.
  class Row {
    constructor(control, setter) {
      this.control = control;
      this.setter = setter; // null for a field of an action, because its value is sent with the action
      this.id = `control-${control.name.replace(/[^\w]/g, "-")}${setter ? "" : "-field"}`;
      this.rejection = make("p", { className: "rejection", id: `${this.id}-rejection`, hidden: true, role: "alert" });
      this.input = this.entry();
      const side = control.side && control.group === "table" ? `${title(control.side)} ` : "";
      const label = make("label", { htmlFor: this.id, title: control.help }, side, title(control.label || control.name));
      if (control.unit) label.append(" ", make("span", { className: "unit" }, control.unit));
      this.node = make("div", { className: `control ${control.kind}`, dataset: { control: control.name } }, label, this.input);
      if (setter) this.node.append(this.revert = this.revert_button());
      this.node.append(this.rejection);
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
        title: minimum === null ? "" : `${format_value(minimum, this.control)} to ${format_value(maximum, this.control)}`,
      });
      this.box.setAttribute("aria-describedby", this.rejection.id);
      this.box.onchange = () => this.read_text();
      const parts = [];
      const step_button = (sign, text) => make("button", {
        type: "button", className: "step", dataset: { step: String(sign) },
        title: `${format_value(step, this.control)} ${sign < 0 ? "less" : "more"}`,
        onclick: () => this.set(Number(((this.pending_value ?? this.valid_value) + sign * step).toFixed(9))),
      }, text);
      if (this.control.group === "monitor" && step) parts.push(step_button(-1, "\u2212"), this.box, step_button(1, "+"));
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
      this.set_options(this.control.choices);
      this.box.onchange = () => this.set(this.box.value);
      return this.box;
    }

    // Set the options of a choice; a selected option is kept if it still exists.
    set_options(names) {
      const selected = this.box.value;
      this.box.replaceChildren(...names.map((name) => make("option", { value: name }, name ? title(name) : "–")));
      if (names.includes(selected)) this.box.value = selected;
      this.box.disabled = names.length < 2;
    }

    switch() {
      this.box = make("input", { type: "checkbox", id: this.id, role: "switch" });
      this.box.onchange = () => this.set(this.box.checked);
      return this.box;
    }

    revert_button() {
      const button = make("button", { type: "button", className: "back" }, "↺");
      button.onclick = () => this.change({ value: this.control.default, reverts: true }, (handler) => link.send(
        { kind: "do", action: "revert", values: { control: this.control.name } }, handler));
      button.setAttribute("aria-label", `${this.control.label || this.control.name}: back to the preset`);
      return button;
    }

    // Return whether the user is editing the value and has not sent it.
    typing() { return document.activeElement === this.box && this.box.value !== this.shown; }

    // Send a typed number. Text that is not a number is sent unchanged, and the simulation returns the error.
    read_text() {
      const text = this.box.value.trim();
      if (text === "") this.show(this.valid_value);
      else this.set(Number.isFinite(Number(text)) ? Number(text) : text);
    }

    value() {
      if (this.control.kind === "number") return this.box.value.trim() === "" ? "" : Number(this.box.value);
      return this.control.kind === "switch" ? this.box.checked : this.box.value;
    }

    set(value) {
      if (!this.setter) { if (this.control.kind === "number") this.show(value); return; }
      this.change({ value, reverts: false }, (handler) => this.setter(value, handler));
    }

    // Apply a change immediately, or add it to the list of waiting changes.
    change(change, send) {
      if (changes.forecasts_first()) { changes.add(this, change); return; }
      if (this.pending_value !== undefined) changes.remove(this);
      this.apply(send);
    }

    show_pending(value) {
      if (this.control.kind === "switch") this.box.checked = Boolean(value);
      else if (this.control.kind === "choice") this.box.value = value;
      else if (this.control.kind === "number" && typeof value === "number") {
        this.box.value = value.toFixed(decimals(this.control.step));
        if (this.slider) this.slider.value = value;
      }
    }

    // Send the value, and show the result: the new value, or the old one and the reason.
    apply(send) {
      this.node.classList.add("pending");
      this.show_rejection("");
      send((event) => {
        const reply = event ?? NO_REPLY;
        this.node.classList.remove("pending");
        if (reply.response !== "applied") this.show_rejection(reply.text);
        else if (reply.value !== null) this.control.value = reply.value;
        this.show(this.control.value);
      });
    }

    update(control) {
      this.control = control;
      const busy = this.node.classList.contains("pending") || this.pending_value !== undefined;
      if (!busy && !this.dragging && !this.typing()) this.show(control.value);
      this.mark();
    }

    show(value) {
      this.valid_value = value;
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
      this.revert.title = `Preset: ${format_value(this.control.default, this.control)}`;
    }

    show_rejection(text) {
      this.rejection.textContent = text;
      this.rejection.hidden = !text;
    }
  }

  // ---- an action and its fields -----------------------------------------------------------------------

  class Action {
    constructor(spec) {
      this.spec = spec;
      this.fields = spec.fields.map((field) => new Row(field, null));
      this.button = make("button", { type: "button", dataset: { action: spec.action }, title: spec.help }, title(spec.label));
      this.button.onclick = () => this.send();
      this.result = make("p", { className: "rejection", hidden: true, role: "alert" });
      this.node = make("fieldset", { className: "action" }, make("legend", {}, title(spec.label)),
        spec.help ? make("p", { className: "help" }, spec.help) : "", ...this.fields.map((row) => row.node), this.button, this.result);
      this.node.classList.toggle("plain", !spec.fields.length);
      for (const row of this.fields) {
        const other = this.fields.find((one) => one.control.name === row.control.depends_on);
        const update_options = () => row.set_options(row.control.choices_by_value[other.value()]);
        if (other) { other.box.addEventListener("change", update_options); update_options(); }
      }
    }

    send() {
      const values = Object.fromEntries(this.fields.map((row) => [row.control.name, row.value()]));
      this.button.classList.add("pending");
      this.show_result("");
      link.send({ kind: "do", action: this.spec.action, values }, (event) => {
        this.button.classList.remove("pending");
        const reply = event ?? NO_REPLY;
        if (reply.response === "applied") this.show_result(reply.text, "done"); else this.show_result(reply.text);
      });
    }

    show_result(text, kind = "") {
      const in_head = ALWAYS_VISIBLE.includes(this.spec.action);
      if (in_head) { if (kind !== "done") head.show_message(text); return; }
      this.result.textContent = text;
      this.result.hidden = !text;
      this.result.classList.toggle("done", kind === "done");
    }
  }

  // ---- all controls ---------------------------------------------------------------------------------

  const board = {
    rows: new Map(),
    actions: new Map(),
    state: null,
    colours: new Map(), // colours of the phases by name
    phase: null,
    joint: null,

    update(state) {
      const same = this.state && this.state.experiment === state.experiment
        && this.state.controls.length === state.controls.length;
      const changed = same && state.controls.some((control, index) => control.value !== this.state.controls[index].value);
      this.state = state;
      if (!same) this.build();
      for (const control of state.controls) this.rows.get(control.name)?.update(control);
      this.compare();
      if (changed) changes.repeat_forecast();
    },

    build() {
      changes.close();
      this.rows.clear();
      this.actions.clear();
      tabs.clear();
      for (const control of this.state.controls) {
        this.rows.set(control.name, new Row(control, (value, handler) =>
          link.send({ kind: "set", control: control.name, value }, handler)));
      }
      for (const spec of this.state.actions) this.actions.set(spec.action, new Action(spec));
      head.shown = null;
      get("panel-quick").replaceChildren(...ALWAYS_VISIBLE.filter((name) => this.actions.has(name)).map((name) => this.actions.get(name).button));
      this.requests(this.actions.get("request")?.spec);
      this.table();
      this.monitor();
      for (const control of this.state.controls) {
        if (!["table", "monitor"].includes(control.group)) tabs.body(control.group).append(this.rows.get(control.name).node);
      }
      for (const [name, action] of this.actions) {
        if (!NOT_IN_TABS.includes(name)) tabs.body(TAB_OF_ACTION[name] ?? action.spec.group).append(action.node);
      }
      tabs.body("walk").append(this.statistics = make("dl", { id: "panel-statistics" }));
    },

    // Make a button for every mode that can be requested, after the present mode.
    requests(spec) {
      get("panel-requests").hidden = !spec;
      if (!spec) return;
      this.mode = make("strong", {});
      const request = (name) => link.send({ kind: "do", action: "request", values: { request: name } }, (event) => {
        const reply = event ?? NO_REPLY;
        head.show_message(reply.response === "applied" ? "" : `${title(name)} was rejected: ${words(reply.text)}`);
      });
      get("panel-requests").replaceChildren(make("p", { title: spec.help }, "Mode ", this.mode),
        ...spec.fields[0].choices.map((name) => make("button", { type: "button", dataset: { request: name }, onclick: () => request(name) }, title(name))));
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
      const controls = this.state.controls.filter((one) => one.group === "monitor");
      const joints = [...new Set(controls.filter((one) => one.joint).map((one) => `${one.side} ${one.joint}`))];
      const quantity = (one) => one.name.split(".").pop();
      this.joints = new Map(joints.map((name) => {
        const chip = make("button", { type: "button", className: "chip plain", dataset: { joint: name } }, title(name), make("i", { className: "dot" }));
        chip.onclick = () => this.choose_joint(name);
        const sheet = make("div", { className: "controls-of-joint" }, ...MONITOR.map(([mode, label, quantities]) => {
          const rows = quantities.flatMap((wanted) => controls.filter((one) => `${one.side} ${one.joint}` === name && quantity(one) === wanted));
          return make("section", { className: "monitor", dataset: { mode } }, make("h3", {}, label), ...rows.map((one) => this.rows.get(one.name).node));
        }));
        return [name, { chip, sheet }];
      }));
      const loose = controls.filter((one) => !one.joint).map((one) => this.rows.get(one.name).node);
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
      if (this.actions.has("revert")) this.differences.append(this.revert_all());
    },

    // Return the name of a control with its phase and joint.
    full_name(one) {
      const location = [one.phase && title(one.phase), one.side, one.joint].filter(Boolean).map(words).join(" ");
      return location ? `${title(location)}: ${one.label.replace("θ0", "θ₀")}` : title(one.label);
    },

    difference(one) {
      const name = this.full_name(one);
      const back = make("button", { type: "button", className: "back", title: "Back to the preset" }, "↺");
      back.setAttribute("aria-label", `${name}: back to the preset`);
      back.onclick = () => this.rows.get(one.name).revert.click();
      return make("tr", { dataset: { difference: one.name } },
        make("td", {}, name),
        make("td", {}, format_value(one.default, one)), make("td", {}, format_value(one.value, one)), make("td", {}, back));
    },

    revert_all() {
      const button = make("button", { type: "button", id: "revert-all" }, "Revert all");
      const rejection = make("p", { className: "rejection", role: "alert", hidden: true });
      button.onclick = () => link.send({ kind: "do", action: "revert", values: { control: "all" } }, (event) => {
        const reply = event ?? NO_REPLY;
        rejection.textContent = reply.text;
        rejection.hidden = reply.response === "applied";
      });
      return make("div", {}, button, rejection);
    },

    deadlines(counts) {
      if (!this.statistics) return;
      const entries = [
        ["Blocks of 10 ms", String(counts.blocks)], ["Late by more than 10 ms", String(counts.late)],
        ["Largest delay", `${counts.worst_ms.toFixed(1)} ms`], ["Skipped time", `${counts.lost_s.toFixed(2)} s`],
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

    body(group) { return get(`body-${TAB_OF_GROUP[group] ?? group}`) ?? get("body-walk"); },

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
        make("small", {}, [`tick ${event.tick}`, event.user, { refused: "rejected", forecast: "forecast" }[event.response]].filter(Boolean).join(" · ")));
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
  get("session-report").href = `report${location.search}`;
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
  setInterval(() => heartbeat.check(), CHECK_PERIOD);
  window.livePanel = { link, board, log, head, view, stopping, heartbeat, changes };
})();
