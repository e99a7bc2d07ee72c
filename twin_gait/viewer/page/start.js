// ---- start of the page ------------------------------------------------------------------------------

// A test, a picture or another page can wait for the promise `ready`.
window.ready = (async () => {
  const page = JSON.parse(element("page-data").textContent), requested = address.read();
  document.body.classList.add(page.mode);
  document.body.classList.toggle("still-picture", requested.picture);
  theme.open(requested.theme);
  // If the bar lies over the page, the page ends above it.
  const bar = element("bar"), measure = () => document.body.style.setProperty("--bar", `${bar.offsetHeight}px`);
  new ResizeObserver(measure).observe(bar);
  try {
    if (page.mode === "live") live.open();
    else { await unpack_bundle(); await (page.mode === "model" ? joints : player).open(page); }
    if (requested.picture && player.stages.some((stage) => stage.without_webgl)) throw new Error("no WebGL for the picture");
    if (requested.picture) { await settled(); console.info("twin_gait: ready"); }
  } catch (error) {
    show_message(`This page needs a browser that is not older than 2023 (${error.message}).`);
    if (requested.picture) console.info(`twin_gait: ${error.message}`);
    throw error;
  }
})();

// Wait for two frames, after which everything has its size and has been drawn.
async function settled() {
  for (let frame = 0; frame < 2; frame += 1) await new Promise((done) => { requestAnimationFrame(done); });
  for (const stage of [...player.stages, joints.stage]) stage?.viewer.render();
}

// Inflate meshcat's viewer, which a recorded page contains in compressed form.
async function unpack_bundle() {
  const packed = element("bundle");
  if (!packed) return;
  const script = make("script");
  script.textContent = new TextDecoder().decode(await inflate(packed.textContent));
  document.head.append(script);
}

window.twinGait = {
  show: (...samples) => live.show(...samples),
  receive: (bytes) => live.stage.receive(bytes),
  page: () => live.page,
  get stage() { return live.stage ?? joints.stage ?? player.stages[0]; },
  plots, joints, theme, show_message, ready: window.ready,
};
