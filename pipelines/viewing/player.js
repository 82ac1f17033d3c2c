// The player: one clock for all panes, their number, and the controls. The address takes #recording=N, &t=SECONDS
// (which pauses), &count=N, &speed=FACTOR and &animal=over|beside|hidden.
"use strict";
(() => {
  const { recordings } = window.PLAYBACK, MOST = 4;
  const byId = (id) => document.getElementById(id);
  const options = { follow: () => byId("follow").checked, animal: () => byId("animal").value };
  const panes = [];
  let first = 0, time = 0, playing = true, last = performance.now();

  const shown = () => panes.slice(0, Number(byId("count").value));
  const fps = () => Math.max(...shown().map((pane) => pane.recording.fps));
  const end = () => Math.max(...shown().map((pane) => (pane.recording.frames - 1) / pane.recording.fps));

  // Side by side on a desk, one above the other on a phone held upright.
  function layout() {
    const count = shown().length, upright = innerHeight > innerWidth;
    const columns = count === 1 ? 1 : count === 2 ? (upright ? 1 : 2) : 2;
    byId("panes").style.gridTemplate = `repeat(${Math.ceil(count / columns)}, 1fr) / repeat(${columns}, 1fr)`;
    byId("panes").classList.toggle("several", count > 1);
    panes.forEach((pane, i) => { pane.box.style.display = i < count ? "" : "none"; });
    shown().forEach((pane) => pane.resize());
  }

  function choose(index) {
    first = (index + recordings.length) % recordings.length;
    const count = Number(byId("count").value);
    while (panes.length < count) panes.push(new Pane(byId("panes"), options));
    shown().forEach((pane, i) => pane.choose((first + i) % recordings.length));
    byId("choice").value = first;
    byId("animal").hidden = !shown().some((pane) => pane.skeleton);
    byId("scrubber").max = Math.round(end() * fps());
    time = 0;
    layout();
  }

  function seek(seconds) {
    playing = false;
    time = Math.max(0, Math.min(end(), seconds));
  }

  function step(direction) {
    if (playing) time = (time + direction + end()) % end();
    else seek((Math.round(time * fps()) + direction) / fps());
  }

  function faster(direction) {
    const select = byId("speed");
    select.selectedIndex = Math.max(0, Math.min(select.length - 1, select.selectedIndex + direction));
  }

  function tick(now) {
    requestAnimationFrame(tick);
    if (playing) time = (time + (now - last) / 1000 * Number(byId("speed").value)) % Math.max(end(), 1e-6);
    last = now;
    byId("play").textContent = playing ? "pause" : "play";
    byId("scrubber").value = Math.round(time * fps());
    shown().forEach((pane) => pane.show(time));
  }

  const toggle = () => { playing = !playing; };
  const again = () => panes.forEach((pane) => { pane.shown = -1; });
  const keys = {
    " ": toggle, ArrowLeft: () => step(-1), ArrowRight: () => step(1), ArrowUp: () => choose(first - 1),
    ArrowDown: () => choose(first + 1), "+": () => faster(1), "=": () => faster(1), "-": () => faster(-1),
  };
  recordings.forEach((recording, i) => byId("choice").add(new Option(recording.name, i)));
  for (let count = 1; count <= Math.min(MOST, recordings.length); count++) {
    if (count !== 3) byId("count").add(new Option(count === 1 ? "one" : `${count} side by side`, count));
  }
  byId("count").hidden = byId("choice").hidden = recordings.length === 1;
  byId("play").onclick = toggle;
  byId("back").onclick = () => step(-1);
  byId("forth").onclick = () => step(1);
  byId("animal").onchange = byId("follow").onchange = again;
  byId("choice").onchange = (event) => choose(Number(event.target.value));
  byId("count").onchange = () => choose(first);
  byId("scrubber").oninput = (event) => seek(Number(event.target.value) / fps());
  // a button keeps no focus: space would press it again
  document.querySelectorAll("button").forEach((button) => button.addEventListener("click", () => button.blur()));
  // nor does a list that the mouse chose from: space would open it again
  document.querySelectorAll("select").forEach((select) => {
    let byMouse = false;
    select.addEventListener("pointerdown", () => { byMouse = true; });
    select.addEventListener("keydown", () => { byMouse = false; });
    select.addEventListener("change", () => { if (byMouse) select.blur(); });
  });
  document.onkeydown = (event) => {
    if (event.target.tagName === "SELECT" || event.ctrlKey || event.altKey || event.metaKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  };
  addEventListener("resize", layout);
  addEventListener("load", layout);

  const asked = new URLSearchParams(location.hash.slice(1));
  for (const name of ["animal", "count", "speed"]) {
    if (asked.has(name) && [...byId(name).options].some((option) => option.value === asked.get(name))) {
      byId(name).value = asked.get(name);
    }
  }
  choose(Math.max(0, Math.min(Number(asked.get("recording")) || 0, recordings.length - 1)));
  if (asked.has("t")) seek(Number(asked.get("t")) || 0);
  requestAnimationFrame(tick);
})();
