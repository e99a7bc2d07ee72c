// ---- scene: meshcat's viewer, its camera, its animation ---------------------------------------------

const DARK_THEME = { top: [0.15, 0.175, 0.205], bottom: [0.055, 0.065, 0.08], floor: 0x39424d, ambient: 1 };

class Stage {
  constructor(label) {
    this.section = make("section", "stage");
    this.pane = make("div", "pane");
    this.pane.setAttribute("role", "img");
    this.pane.setAttribute("aria-label", `${label}; drag to turn, scroll to zoom`);
    this.head = make("div", "head card");
    this.picture = make("canvas", "picture");
    this.section.append(this.pane, this.picture, this.head);
    element("stages").append(this.section);
    this.viewer = null;
    this.view = null;
    this.floor = null;
    this.light_theme = { top: [1, 1, 1], bottom: [1, 1, 1], ambient: 0.6 };
    this.must_paint = false;
    this.turned = false;
    this.without_webgl = false; // true without WebGL: there is no scene, but everything else works
  }

  open() {
    try { this.viewer = new MeshCat.Viewer(this.pane); } catch (error) { this.disable(error); return; }
    this.viewer.gui.domElement.style.display = "none";
    this.viewer.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const shadow = this.viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.shadow;
    shadow.mapSize.set(1024, 1024);
    shadow.normalBias = 0.01;
    shadow.bias = -0.0005;
    shadow.radius = 3;
    // Meshcat uses the height of the window; here a pane may be a part of it.
    const inner = this.viewer.set_3d_pane_size.bind(this.viewer);
    this.viewer.set_3d_pane_size = () => {
      inner(Math.max(this.pane.clientWidth, 1), Math.max(this.pane.clientHeight, 1));
      this.shift();
    };
    this.viewer.controls.addEventListener("start", () => { this.turned = true; });
    new ResizeObserver(() => this.refit()).observe(this.pane);
    const handle = this.viewer.handle_command.bind(this.viewer);
    this.viewer.handle_command = (command) => { handle(command); this.store_light_theme(command); };
    theme.listeners.push(() => this.paint());
  }

  // Replace the viewer by an object that accepts commands and draws nothing.
  disable(error) {
    this.without_webgl = true;
    this.pane.replaceChildren(make("p", "absent", "No scene: this browser has no WebGL. Numbers, curves and timeline work without."));
    this.pane.setAttribute("aria-label", "No scene");
    console.info(`twin_gait: no WebGL (${error.message})`);
    const nothing = () => {};
    this.viewer = Object.assign(Object.create(MeshCat.Viewer.prototype), {
      handle_command: nothing, render: nothing, set_dirty: nothing, animator: { pause: nothing, seek: nothing },
    });
  }

  // Store the colours and the light that the program sets; they are used by the light theme.
  store_light_theme({ type, path, property, value }) {
    const key = `${path}.${property}`;
    if (type === "set_object" && path === this.floor) this.light_theme.floor = this.find(path).material.color.getHex();
    else if (type !== "set_property") return;
    else if (key === "/Background.top_color") this.light_theme.top = value;
    else if (key === "/Background.bottom_color") this.light_theme.bottom = value;
    else if (key === "/Lights/AmbientLight/<object>.intensity") this.light_theme.ambient = value;
    else return;
    if (this.must_paint) return;
    this.must_paint = true;
    requestAnimationFrame(() => this.paint());
  }

  find(path) { return this.viewer.scene_tree.find([...path.split("/").filter((part) => part), "<object>"]).object; }

  // Apply the theme: in the dark theme only the surroundings of the figure are darker.
  paint() {
    this.must_paint = false;
    if (this.without_webgl) return;
    const set = theme.dark ? { ...DARK_THEME, ambient: this.light_theme.ambient * DARK_THEME.ambient } : this.light_theme;
    this.viewer.set_property(["Background"], "top_color", set.top);
    this.viewer.set_property(["Background"], "bottom_color", set.bottom);
    this.find("Lights/AmbientLight").intensity = set.ambient;
    if (this.light_theme.floor !== undefined) this.find(this.floor).material.color.setHex(set.floor);
    this.viewer.set_dirty();
  }

  // Fit the view to a new size of the pane; a view that the user has turned is kept.
  refit() {
    if (!this.pane.clientHeight || this.without_webgl) return;
    if (this.view && !this.turned) this.look(this.view); else this.viewer.set_3d_pane_size();
    // Resizing has cleared the canvas, which must be drawn again within the same frame.
    this.viewer.render();
  }

  look(view) {
    this.view = view;
    this.turned = false;
    if (this.without_webgl) return;
    // three.js has y up: (x, y, z) of the scene is (x, z, -y) there.
    const [x, y, z] = view.target, [dx, dy, dz] = view.direction;
    const camera = this.viewer.camera, target = new MeshCat.THREE.Vector3(x, z, -y);
    camera.fov = view.field_of_view;
    camera.near = 0.05;
    camera.position.set(dx, dz, -dy).normalize().multiplyScalar(this.distance()).add(target);
    this.viewer.controls.target.copy(target);
    this.viewer.set_3d_pane_size();
  }

  // Compute the part of the pane that no card covers.
  visible_area() {
    const pane = this.pane.getBoundingClientRect();
    const free = { left: pane.left, right: pane.right, top: pane.top, bottom: pane.bottom };
    if (getComputedStyle(this.section).position === "fixed") {
      const plots = element("plots").getBoundingClientRect();
      const head = this.head.getBoundingClientRect();
      if (head.height > 0.25 * pane.height) free.left = Math.max(free.left, head.right);
      if (plots.width) free.right = Math.min(free.right, plots.left);
      free.bottom = Math.min(free.bottom, element("bar").getBoundingClientRect().top);
    } else if (getComputedStyle(this.head).position === "absolute") {
      free.left = Math.max(free.left, this.head.getBoundingClientRect().right);
    }
    if (free.right - free.left < 0.22 * pane.width) { free.left = pane.left; free.right = pane.right; }
    return {
      width: pane.width, height: pane.height, wide: free.right - free.left, high: Math.max(free.bottom - free.top, 100),
      aside: (pane.left + pane.right - free.left - free.right) / 2, rise: (pane.top + pane.bottom - free.top - free.bottom) / 2,
    };
  }

  distance() {
    const area = this.visible_area(), half = Math.tan((Math.PI / 360) * this.view.field_of_view);
    const tall = (this.view.height * area.height) / area.high;
    const broad = (this.view.width * area.height) / area.wide;
    return Math.max(tall, Math.min(broad, 1.2 * tall)) / (2 * half);
  }

  shift() {
    if (!this.view) return;
    const { width, height, aside, rise } = this.visible_area();
    this.viewer.camera.setViewOffset(width, height, aside, rise, width, height);
    this.viewer.set_dirty();
  }

  // Read one command or several. A single command begins like a msgpack map, which cannot be a valid length.
  receive(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    if (bytes.length < 4 || view.getUint32(0, true) > bytes.length - 4) {
      this.viewer.handle_command_bytearray(bytes);
      return;
    }
    for (let at = 0; at < bytes.length;) {
      const length = view.getUint32(at, true);
      this.viewer.handle_command_bytearray(bytes.slice(at + 4, at + 4 + length));
      at += 4 + length;
    }
  }

  seek(time) { this.viewer.animator.seek(time); }

  // Copy the scene to a picture for printing, because browsers do not print WebGL. The copy must follow the
  // rendering immediately, while its buffer is valid.
  copy_to_picture(width = 900, height = 860) {
    const { viewer } = this;
    if (this.without_webgl) return;
    viewer.camera.clearViewOffset();
    viewer.camera.aspect = width / height;
    viewer.renderer.setSize(width, height);
    viewer.render();
    Object.assign(this.picture, { width, height });
    this.picture.getContext("2d").drawImage(viewer.renderer.domElement, 0, 0, width, height);
    viewer.set_3d_pane_size();
  }
}
