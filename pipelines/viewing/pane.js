// One view of one recording: meshcat's viewer, what holds at the frame that is shown, and an arrow at the edge
// where the target is out of sight. The player decides which recording and which frame.
"use strict";
window.Pane = class {
  static STANDS = 0x1f9d55;
  static EDGE = 30;  // pixels from the border to the arrow
  static bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  constructor(parent, options) {
    const { scene, feet } = window.PLAYBACK;
    this.options = options;
    this.box = this.element(parent, "div", "pane");
    this.place = this.element(this.box, "div", "meshcat-pane");
    this.viewer = new MeshCat.Viewer(this.place);
    // meshcat's own size is that of the window
    this.viewer.set_3d_pane_size = () => MeshCat.Viewer.prototype.set_3d_pane_size.call(
      this.viewer, this.place.clientWidth, this.place.clientHeight);
    scene.forEach((command) => this.viewer.handle_command_bytearray(Pane.bytes(command)));
    this.facts = this.element(this.box, "div", "facts");
    this.pointer = this.element(this.box, "div", "pointer");
    this.arrow = this.element(this.pointer, "i", "", "\u27a4");
    this.distance = this.element(this.pointer, "span", "");
    this.feet = feet.map((foot) => foot.geoms.flatMap((path) => {
      const found = [];
      this.node(path).object.traverse((o) => { if (o.material) found.push([o.material, o.material.color.getHex()]); });
      return found;
    }));
    this.bones = new Map();
  }

  node(path) { return this.viewer.scene_tree.find(path.split("/")); }

  element(parent, tag, className, text) {
    const made = parent.appendChild(document.createElement(tag));
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  }

  choose(index) {
    const { recordings } = window.PLAYBACK;
    this.index = index;
    this.recording = recordings[index];
    this.shown = -1;
    recordings.forEach((_, i) => this.viewer.set_property(["world", `recording${i}`], "visible", i === index));
    this.viewer.handle_command_bytearray(Pane.bytes(this.recording.animation));
    this.viewer.animator.pause();
    this.viewer.animator.actions.forEach((action) => action.play());  // what never ran cannot be sought
    this.skeleton = this.recording.skeleton ? new Float32Array(Pane.bytes(this.recording.skeleton).buffer) : null;
  }

  // A picture that is higher than wide would cut the robot off at its sides.
  resize() {
    this.viewer.camera.zoom = Math.min(1, this.place.clientWidth / Math.max(1, this.place.clientHeight));
    this.viewer.set_3d_pane_size();
  }

  show(time) {
    const recording = this.recording, frame = Math.min(Math.round(time * recording.fps), recording.frames - 1);
    if (frame !== this.shown) {
      this.shown = frame;
      this.viewer.animator.seek(frame / recording.fps);
      this.write(frame);
      this.draw(frame);
    }
    this.point();
  }

  write(frame) {
    const recording = this.recording, box = this.facts, vector = (v) => `(${v.map((x) => x.toFixed(2)).join(", ")})`;
    box.textContent = "";
    this.element(box, "h2", "", recording.name);
    if (recording.note) this.element(box, "p", "note", recording.note);
    this.element(box, "p", "", `time ${(frame / recording.fps).toFixed(2)} s \u00b7 ` +
      `speed ${recording.speed[frame].toFixed(2)} m/s \u00b7 height ${recording.height[frame].toFixed(3)} m`);
    if (recording.target) {
      this.element(box, "p", "", `target ${vector(recording.target[frame])} m \u00b7 ` +
        `distance ${(100 * recording.distance[frame]).toFixed(1)} cm`);
    }
    if (recording.contacts) {
      window.PLAYBACK.feet.forEach((foot, i) =>
        this.element(box, "span", recording.contacts[frame][i] ? "foot stands" : "foot", foot.name));
    }
    (recording.latent ? recording.latent[frame] : []).forEach((z, i) => {
      const bar = this.element(box, "div", "bar"), fill = this.element(bar, "i");
      fill.style.left = `${50 + 50 * Math.min(z, 0)}%`;
      fill.style.width = `${50 * Math.abs(z)}%`;
      this.element(bar, "span", "", `z${i + 1} ${z.toFixed(2)}`);
    });
  }

  draw(frame) {
    const recording = this.recording, own = `world/recording${this.index}`;
    this.feet.forEach((parts, i) => parts.forEach(([material, colour]) =>
      material.color.setHex(recording.contacts && recording.contacts[frame][i] ? Pane.STANDS : colour)));
    this.node(`${own}/trace/<object>`).object.geometry.setDrawRange(0, frame + 1);
    if (recording.target) this.node(`${own}/target`).object.position.set(...recording.target[frame]);
    // meshcat's camera looks at the origin whatever happens, so the world moves instead
    const [x, y] = recording.camera[frame];
    if (this.options.follow()) this.node("world").object.position.set(-x, -y, -window.PLAYBACK.eyeHeight);
    if (this.skeleton) this.drawAnimal(frame);
    this.viewer.set_dirty();
  }

  // Lines are one pixel thin wherever WebGL draws them, so each bone is a rod.
  rods() {
    if (!this.bones.has(this.index)) {
      const first = this.node(`world/recording${this.index}/bone/<object>`).object;
      const others = this.recording.bones.slice(1).map(() => first.parent.add(first.clone()) &&
        first.parent.children[first.parent.children.length - 1]);
      this.bones.set(this.index, [first, ...others]);
    }
    return this.bones.get(this.index);
  }

  drawAnimal(frame) {
    const where = this.options.animal(), width = this.skeleton.length / this.recording.frames;
    const [x, y] = where === "beside" ? this.recording.aside[frame] : [0, 0];
    const at = (point) => {
      const start = frame * width + 3 * point;
      return this.viewer.camera.position.clone().set(
        this.skeleton[start] + x, this.skeleton[start + 1] + y, this.skeleton[start + 2]);
    };
    this.rods().forEach((rod, i) => {
      const [from, to] = this.recording.bones[i].map(at), way = to.clone().sub(from), length = way.length();
      rod.visible = where !== "hidden" && length > 1e-6;
      rod.position.copy(from).add(to).multiplyScalar(0.5);
      rod.scale.set(1, length, 1);
      rod.quaternion.setFromUnitVectors(way.clone().set(0, 1, 0), way.normalize());
    });
    const joints = this.node(`world/recording${this.index}/joints/<object>`).object;
    const positions = joints.geometry.attributes.position;
    for (let point = 0; point < width / 3; point++) positions.setXYZ(point, ...at(point).toArray());
    positions.needsUpdate = true;
    joints.frustumCulled = false;
    joints.visible = where !== "hidden";
  }

  // An arrow at the border that points to a target that is out of sight.
  point() {
    const recording = this.recording, camera = this.viewer.camera;
    this.pointer.hidden = true;
    if (!recording.target) return;
    const target = this.node(`world/recording${this.index}/target`).object;
    const seen = target.getWorldPosition(camera.position.clone());
    camera.updateMatrixWorld();
    const ahead = seen.clone().applyMatrix4(camera.matrixWorldInverse).z < 0;
    seen.project(camera);
    let [x, y] = ahead ? [seen.x, seen.y] : [-seen.x, -seen.y];
    if (ahead && Math.max(Math.abs(x), Math.abs(y)) < 1) return;
    const wide = this.place.clientWidth / 2, high = this.place.clientHeight / 2;
    x *= wide;
    y *= -high;
    const share = Math.min((wide - Pane.EDGE) / Math.max(1e-9, Math.abs(x)), (high - Pane.EDGE) / Math.max(1e-9, Math.abs(y)));
    this.pointer.hidden = false;
    this.pointer.style.left = `${wide + share * x}px`;
    this.pointer.style.top = `${high + share * y}px`;
    this.arrow.style.transform = `rotate(${Math.atan2(y, x)}rad)`;
    const inward = -34 / Math.max(1e-9, Math.hypot(x, y));
    this.distance.style.left = `${inward * x}px`;
    this.distance.style.top = `${inward * y}px`;
    this.distance.textContent = `${recording.distance[this.shown].toFixed(2)} m`;
  }
};
