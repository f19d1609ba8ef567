// The page: what arrives is drawn, what the user does is asked for.

import { Cloud } from "./cloud.js";
import { Connection } from "./connection.js";
import { describeObstacles, paintObstacles } from "./obstacles.js";
import {
  coveredPart, fillLegend, paintBlend, paintConfidence, paintDepth, paintImage, paintLabels, paintScale,
} from "./panes.js";
import { Plot } from "./plots.js";
import { SECTION, UNITS, parseFrame, unpackBytes, unpackDepth, unpackObstacles } from "./protocol.js";
import { element, listen, settings } from "./settings.js";

const state = {
  camera: null, // its name
  description: null, // classes and rays
  palette: [],
  frame: null,
  depth: null,
  labels: null,
  confidence: null,
  obstacles: null,
  range: null,
  point: null, // where the readout is: u and v as shares of depth, pane
  isPaused: false,
  shown: 0,
  recent: [], // times and sizes of the last frames
};
const canvases = Object.fromEntries(["image", "depth", "labels", "confidence", "blend"].map((id) => [id, element(id)]));
const cloud = new Cloud(element("cloud"));
const latencyPlot = new Plot(element("latency-plot"));
const ratePlot = new Plot(element("rate-plot"));

// What arrives ------------------------------------------------------------------------------------------------------------

let newest = null;
let isBusy = false;

const connection = new Connection({
  open() {},
  closed: (message) => say(message, true),
  report: (report) => reports[report.type]?.(report),
  frame(buffer) {
    newest = buffer;
    if (!isBusy) drawNewest();
  },
});

const reports = {
  hello({ cameras, palette }) {
    state.palette = Array.from({ length: palette.length / 3 }, (_, i) => palette.slice(3 * i, 3 * i + 3));
    paintScale(element("scale"), state.palette);
    const options = cameras.map((name) => new Option(name, name));
    element("camera").replaceChildren(...options);
    if (!cameras.includes(state.camera)) state.camera = cameras[0] ?? null;
    element("camera").value = state.camera ?? "";
    say(cameras.length ? "waiting for a frame" : "the cameras are starting");
    watch();
  },
  camera(description) {
    state.description = description;
  },
  status({ status }) {
    for (const [name, count] of Object.entries(status.frames)) {
      const cell = element(name);
      if (cell) cell.textContent = count;
    }
    ratePlot.add(1, status.fps, "--warm");
    drawRates(status);
  },
  probe: (probe) => showProbe(probe),
  error: ({ message }) => say(message, true),
};

/** Draws the newest frame; one that arrives meanwhile comes next, those between are skipped. */
async function drawNewest() {
  isBusy = true;
  while (newest) {
    const buffer = newest;
    newest = null;
    try {
      await show(parseFrame(buffer));
    } catch (error) {
      say(`cannot show a frame: ${error.message}`, true);
      console.error(error);
    }
  }
  isBusy = false;
}

async function show(frame) {
  const jpeg = frame.sections.get(SECTION.image);
  const [bitmap, depth, labels, confidence] = await Promise.all([
    jpeg && createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })),
    unpackDepth(frame),
    unpackBytes(frame, SECTION.labels),
    unpackBytes(frame, SECTION.confidence),
  ]);
  Object.assign(state, { frame, depth, labels, confidence, obstacles: unpackObstacles(frame) });
  state.shown++;
  if (bitmap) {
    paintImage(canvases.image, bitmap);
    bitmap.close();
  }
  redraw();
  measure(frame);
  probe();
}

// What is drawn -----------------------------------------------------------------------------------------------------------

function redraw() {
  const { frame, depth, labels, confidence } = state;
  if (!frame) return;
  updateRange(frame);
  if (depth) paintDepth(canvases.depth, depth, frame, state.palette, state.range);
  if (labels) {
    paintLabels(canvases.labels, labels, frame);
    fillLegend(element("legend"), labels, state.description?.classes ?? []);
  }
  if (confidence) paintConfidence(canvases.confidence, confidence, frame);
  arrange();
  if (settings.isBlended) {
    const { image, depth } = canvases;
    const layers = { image, depth, labels: labels && canvases.labels, confidence: confidence && canvases.confidence };
    paintBlend(canvases.blend, layers, frame.view, settings.shares);
  }
  drawCloud();
  drawObstacles();
}

function drawObstacles() {
  const { obstacles, description } = state;
  if (!obstacles) return;
  paintObstacles(element("obstacles"), obstacles);
  const text = describeObstacles(obstacles, description?.classes ?? []);
  element("obstacle-text").textContent = text;
  element("obstacles").setAttribute("aria-label", `Obstacles from above. Nearest: ${text}`);
}

function drawCloud() {
  const { frame, depth, description } = state;
  const note = element("cloud-note");
  const missing = !description?.rays && "No cloud: the camera has no calibration.";
  const relative = frame.units !== UNITS.metre && "No cloud: depth of this model is relative.";
  const problem = cloud.problem || relative || missing || "";
  note.textContent = problem;
  note.hidden = !problem;
  if (problem || !depth) return;
  const colors = state[settings.cloudColors] === null ? canvases.depth : canvases[settings.cloudColors];
  cloud.update(depth, frame, description.rays, colors, covered(colors));
}

const covered = (canvas) => coveredPart([canvases.image, canvases.blend].includes(canvas), state.frame?.view);

/** Colors follow slowly, so that they do not flicker. */
function updateRange({ near, far, units }) {
  if (!settings.isAutomatic) {
    state.range = settings.range;
  } else if (!state.range || !Number.isFinite(state.range.near)) {
    state.range = { near, far };
  } else {
    const follow = (old, value) => old + 0.15 * (value - old);
    state.range = { near: follow(state.range.near, near), far: follow(state.range.far, far) };
  }
  const unit = units === UNITS.metre ? " m" : "";
  element("range-text").textContent = `${state.range.near.toFixed(2)} to ${state.range.far.toFixed(2)}${unit}`;
}

function arrange() {
  const shown = {
    image: !settings.isBlended,
    depth: !settings.isBlended,
    labels: !settings.isBlended && Boolean(state.labels),
    confidence: !settings.isBlended && Boolean(state.confidence) && settings.showsConfidence,
    blend: settings.isBlended,
    obstacles: Boolean(state.obstacles),
  };
  for (const figure of document.querySelectorAll("[data-pane]")) {
    const isShown = shown[figure.dataset.pane];
    if (isShown !== undefined) figure.hidden = !isShown;
  }
}

function measure(frame) {
  const now = performance.now();
  state.recent.push({ now, bytes: frame.bytes });
  state.recent = state.recent.filter((one) => now - one.now < 3000);
  const seconds = Math.max((now - state.recent[0].now) / 1000, 0.001);
  const count = state.recent.length - 1;
  const fps = count / seconds;
  const bytes = state.recent.slice(1).reduce((sum, one) => sum + one.bytes, 0);
  latencyPlot.add(0, frame.latencyMs, "--accent");
  ratePlot.add(0, fps, "--accent");
  element("latency-text").textContent = `${frame.latencyMs.toFixed(1)} ms from capture to publishing`;
  element("shown").textContent = state.shown;
  latencyPlot.draw();
  if (!state.isPaused && count > 0) {
    say(`live, ${fps.toFixed(1)} fps, ${((bytes * 8e-6) / seconds).toFixed(1)} Mbit/s`);
    state.fps = fps;
  } else if (!state.isPaused) {
    say("live");
  }
}

function drawRates(status) {
  const here = state.fps ? `${state.fps.toFixed(1)} here, ` : "";
  element("rate-text").textContent = `${here}${status.fps.toFixed(1)} published`;
  if (!status.up) say("the camera gives no frames", true);
  ratePlot.draw();
}

function say(message, isProblem = false) {
  const line = element("state");
  if (line.textContent !== message) line.textContent = message;
  line.classList.toggle("problem", isProblem);
}

// The readout -------------------------------------------------------------------------------------------------------------

/** Asks for the depth at the point of the readout, in the frame that is shown. */
function probe() {
  if (state.point) connection.send({ type: "probe", u: state.point.u, v: state.point.v });
}

function showProbe({ x, y, depth, label, confidence, sequence }) {
  const unit = state.frame?.units === UNITS.metre ? " m" : " (relative)";
  const text = depth === null ? "no measurement" : `${depth.toFixed(3)}${unit}`;
  const name = label === null ? "" : `, ${state.description?.classes[label] ?? `class ${label}`}`;
  const readout = element("readout");
  const certainty = confidence === null ? "" : `, confidence ${Math.round((100 * confidence) / 255)} %`;
  readout.textContent = `${text} at column ${x}, row ${y}${name}${certainty}`;
  Object.assign(readout.dataset, { x, y, depth: depth ?? "", confidence: confidence ?? "", sequence });
  if (state.point?.byKeyboard) element("announcement").textContent = readout.textContent;
  placeMarker();
}

function placeMarker() {
  const marker = element("marker");
  const { u, v, pane } = state.point ?? {};
  marker.hidden = !pane || pane.closest("figure").hidden;
  if (marker.hidden) return;
  const [inner, outer] = [pane.getBoundingClientRect(), element("panes").getBoundingClientRect()];
  const [left, top, width, height] = covered(pane);
  marker.style.left = `${inner.left - outer.left + (left + u * width) * inner.width}px`;
  marker.style.top = `${inner.top - outer.top + (top + v * height) * inner.height}px`;
}

function pointAt(event) {
  const pane = event.currentTarget;
  const box = pane.getBoundingClientRect();
  const share = (value) => Math.max(0, Math.min(1, value));
  const [left, top, width, height] = covered(pane);
  // Beside the part that depth covers, the nearest pixel of it.
  const u = share(((event.clientX - box.left) / box.width - left) / width);
  const v = share(((event.clientY - box.top) / box.height - top) / height);
  state.point = { u, v, pane, byKeyboard: false };
  probe();
}

const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function moveByKey(event) {
  const step = STEPS[event.key];
  if (!step || !state.frame) return;
  event.preventDefault();
  const { depthWidth, depthHeight } = state.frame;
  const pixels = event.shiftKey ? 10 : 1;
  const { u, v } = state.point ?? { u: 0.5, v: 0.5 };
  // The center of the next pixel.
  const move = (share, side, by) => {
    const index = Math.min(side - 1, Math.floor(share * side)) + by * pixels;
    return (Math.max(0, Math.min(side - 1, index)) + 0.5) / side;
  };
  const point = { u: move(u, depthWidth, step[0]), v: move(v, depthHeight, step[1]) };
  state.point = { ...point, pane: event.currentTarget, byKeyboard: true };
  probe();
}

for (const canvas of Object.values(canvases)) {
  canvas.addEventListener("pointermove", pointAt);
  canvas.addEventListener("pointerdown", pointAt);
  canvas.addEventListener("keydown", moveByKey);
}

// What the user does ------------------------------------------------------------------------------------------------------

/** Asks for frames, or for none while the page is paused or hidden. */
function watch() {
  if (!state.camera) return;
  if (state.isPaused || document.hidden) connection.send({ type: "pause" });
  else connection.send({ type: "watch", camera: state.camera, ...settings.request });
}

function setPaused(isPaused) {
  state.isPaused = isPaused;
  const button = element("pause");
  button.setAttribute("aria-pressed", String(isPaused));
  button.textContent = isPaused ? "Resume" : "Pause";
  if (isPaused) say("paused");
  state.recent = [];
  watch();
}

element("pause").addEventListener("click", () => setPaused(!state.isPaused));
element("reset-cloud").addEventListener("click", () => cloud.reset());
element("camera").addEventListener("change", () => {
  Object.assign(state, { camera: element("camera").value, description: null, range: null, recent: [], point: null });
  latencyPlot.clear();
  ratePlot.clear();
  setPaused(false);
});
document.addEventListener("visibilitychange", () => {
  state.recent = [];
  watch();
});
document.addEventListener("keydown", (event) => {
  const isTyping = event.target.matches("input, select, button");
  if (event.key === " " && !isTyping) {
    event.preventDefault();
    setPaused(!state.isPaused);
  }
});
addEventListener("resize", placeMarker);

function applyTheme() {
  document.documentElement.style.colorScheme = settings.theme;
  latencyPlot.draw();
  ratePlot.draw();
}

function enableRange() {
  for (const id of ["near", "far"]) element(id).disabled = settings.isAutomatic;
}

listen((id) => {
  if (id === "theme") return applyTheme();
  if (id.startsWith("max-")) return watch();
  if (id === "show-confidence") watch();
  if (id === "auto") {
    enableRange();
    if (!settings.isAutomatic && state.range) {
      element("near").value = state.range.near.toFixed(2);
      element("far").value = state.range.far.toFixed(2);
    }
  }
  redraw();
  placeMarker();
});
applyTheme();
enableRange();
