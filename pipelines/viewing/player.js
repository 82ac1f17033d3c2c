// The player beside meshcat's viewer: chooses a recording, seeks its animation, and writes down what
// holds at the frame that is shown. The address takes #recording=N&t=SECONDS (which pauses) and
// &animal=over|beside|hidden.
"use strict";
(() => {
  const { scene, recordings, feet, eyeHeight } = window.PLAYBACK;
  const STANDS = 0x1f9d55;
  const byId = (id) => document.getElementById(id);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const viewer = new MeshCat.Viewer(byId("meshcat-pane"));
  const node = (path) => viewer.scene_tree.find(path.split("/"));
  scene.forEach((command) => viewer.handle_command_bytearray(bytes(command)));

  let current = 0, shown = -1, skeleton = null;
  const materials = feet.map((foot) => foot.geoms.flatMap((path) => {
    const found = [];
    node(path).object.traverse((o) => { if (o.material) found.push([o.material, o.material.color.getHex()]); });
    return found;
  }));

  function choose(index) {
    current = index;
    shown = -1;
    const recording = recordings[index];
    recordings.forEach((_, i) => viewer.set_property(["world", `recording${i}`], "visible", i === index));
    viewer.handle_command_bytearray(bytes(recording.animation));
    skeleton = recording.skeleton ? new Float32Array(bytes(recording.skeleton).buffer) : null;
    byId("animal").hidden = !skeleton;
    byId("scrubber").max = recording.frames - 1;
    byId("choice").value = index;
  }

  function seek(time) {
    viewer.animator.pause();
    viewer.animator.actions.forEach((action) => action.play());  // an action that never ran cannot be sought
    viewer.animator.seek(time);
    viewer.animator.display_progress(time);
  }

  const vector = (v) => `(${v.map((x) => x.toFixed(2)).join(", ")})`;

  function facts(recording, frame) {
    const lines = [`time ${(frame / recording.fps).toFixed(2)} s   speed ${recording.speed[frame].toFixed(2)} m/s   ` +
                   `height ${recording.height[frame].toFixed(3)} m`];
    if (recording.target) {
      lines.push(`target ${vector(recording.target[frame])} m   ` +
                 `distance ${(100 * recording.distance[frame]).toFixed(1)} cm`);
    }
    return lines.join("\n");
  }

  function element(parent, tag, className, text) {
    const made = parent.appendChild(document.createElement(tag));
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    return made;
  }

  function write(recording, frame) {
    const box = byId("facts");
    box.textContent = "";
    element(box, "h1", "", recording.name);
    if (recording.note) element(box, "p", "note", recording.note);
    element(box, "p", "", facts(recording, frame));
    if (recording.contacts) {
      feet.forEach((foot, i) => element(box, "span", recording.contacts[frame][i] ? "foot stands" : "foot", foot.name));
    }
    (recording.latent ? recording.latent[frame] : []).forEach((z, i) => {
      const bar = element(box, "div", "bar"), fill = element(bar, "i");
      fill.style.left = `${50 + 50 * Math.min(z, 0)}%`;
      fill.style.width = `${50 * Math.abs(z)}%`;
      element(bar, "span", "", `z${i + 1} ${z.toFixed(2)}`);
    });
  }

  function draw(recording, frame) {
    materials.forEach((parts, i) => parts.forEach(([material, own]) =>
      material.color.setHex(recording.contacts && recording.contacts[frame][i] ? STANDS : own)));
    node(`world/recording${current}/trace/<object>`).object.geometry.setDrawRange(0, frame + 1);
    if (recording.target) node(`world/recording${current}/target`).object.position.set(...recording.target[frame]);
    if (byId("follow").checked) follow(...recording.camera[frame]);
    if (skeleton) drawBones(recording, frame);
    viewer.set_dirty();
  }

  // meshcat's camera looks at the origin whatever happens, so the world moves instead.
  function follow(x, y) {
    node("world").object.position.set(-x, -y, -eyeHeight);
  }

  function drawBones(recording, frame) {
    const where = byId("animal").value, width = skeleton.length / recording.frames;
    const [x, y] = where === "beside" ? recording.aside[frame] : [0, 0];
    const place = (name, points) => {
      const drawn = node(`world/recording${current}/${name}/<object>`).object;
      const positions = drawn.geometry.attributes.position;
      points.forEach((point, i) => {
        const start = frame * width + 3 * point;
        positions.setXYZ(i, skeleton[start] + x, skeleton[start + 1] + y, skeleton[start + 2]);
      });
      positions.needsUpdate = true;
      drawn.frustumCulled = false;
      drawn.visible = where !== "hidden";
    };
    place("bones", recording.bones.flat());
    place("joints", Array.from({ length: width / 3 }, (_, point) => point));
  }

  function tick() {
    requestAnimationFrame(tick);
    const recording = recordings[current];
    const frame = Math.min(Math.round(viewer.animator.time * recording.fps), recording.frames - 1);
    byId("play").textContent = viewer.animator.playing ? "pause" : "play";
    if (frame === shown) return;
    shown = frame;
    byId("scrubber").value = frame;
    write(recording, frame);
    draw(recording, frame);
  }

  recordings.forEach((recording, i) => { element(byId("choice"), "option", "", recording.name).value = i; });
  const toggle = () => (viewer.animator.playing ? viewer.animator.pause() : viewer.animator.play());
  byId("play").onclick = toggle;
  byId("animal").onchange = byId("follow").onchange = () => { shown = -1; };
  byId("choice").onchange = (event) => choose(Number(event.target.value));
  byId("scrubber").oninput = (event) => seek(Number(event.target.value) / recordings[current].fps);
  document.onkeydown = (event) => { if (event.key === " " && event.target === document.body) toggle(); };

  const asked = new URLSearchParams(location.hash.slice(1));
  if (asked.has("animal")) byId("animal").value = asked.get("animal");
  choose(Math.min(Number(asked.get("recording") || 0), recordings.length - 1));
  if (asked.has("t")) seek(Number(asked.get("t")));
  tick();
})();
