// Image, depth, labels and confidence on flat canvases.

const NO_DEPTH = [150, 150, 150];

/** A color for each class: hues as different as possible for neighboring numbers. */
export function labelColor(label) {
  const hue = (label * 137.508) % 360;
  const lightness = 0.4 + 0.1 * (label % 3);
  const part = (offset) => {
    const k = (offset + hue / 30) % 12;
    return Math.round(255 * (lightness - 0.4 * Math.max(-1, Math.min(k - 3, 9 - k, 1))));
  };
  return [part(0), part(8), part(4)];
}

export function resize(canvas, width, height) {
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
}

/** The part of a pane that depth covers: left, top, width, height, as shares of the pane. `view` is that of the image. */
export function coveredPart(showsImage, view) {
  const isKnown = view?.[2] > 0 && view[3] > 0;
  return showsImage && isKnown ? view : [0, 0, 1, 1];
}

/** Fills a canvas from one color per pixel. */
function paint(canvas, width, height, colorOf) {
  resize(canvas, width, height);
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < pixels.length; i++) pixels[i] = colorOf(i);
  context.putImageData(image, 0, 0);
}

/** A canvas pixel in memory: red in the lowest byte. */
const pixel = ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r;

export function paintImage(canvas, bitmap) {
  resize(canvas, bitmap.width, bitmap.height);
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
}

/** Depth from near (first color) to far (last color). */
export function paintDepth(canvas, depth, { width, height }, palette, { near, far }) {
  const colors = palette.map(pixel);
  const none = pixel(NO_DEPTH);
  const last = colors.length - 1;
  const scale = last / Math.max(far - near, 1e-9);
  paint(canvas, width, height, (i) => {
    const index = (depth[i] - near) * scale + 0.5;
    // Comparisons with NaN are false.
    return index >= 0 ? colors[Math.min(index | 0, last)] : index < 0 ? colors[0] : none;
  });
}

export function paintLabels(canvas, labels, { width, height }) {
  const colors = Array.from({ length: 256 }, (_, label) => pixel(labelColor(label)));
  paint(canvas, width, height, (i) => colors[labels[i]]);
}

/** Confidence from uncertain (black) to certain (white). */
export function paintConfidence(canvas, confidence, { width, height }) {
  const grays = Array.from({ length: 256 }, (_, value) => pixel([value, value, value]));
  paint(canvas, width, height, (i) => grays[confidence[i]]);
}

export function paintScale(canvas, palette) {
  paint(canvas, palette.length, 1, (i) => pixel(palette[i]));
}

/** The image with depth and labels over the part of it that they cover; the less certain, the darker. */
export function paintBlend(canvas, { image, depth, labels, confidence }, [left, top, width, height], shares) {
  const base = image.width > 1 ? image : depth;
  const covered = base === image ? [left, top, width, height] : [0, 0, 1, 1];
  resize(canvas, base.width, base.height);
  const context = canvas.getContext("2d");
  const { depthShare, labelShare, confidenceShare } = shares;
  const layers = [[base, 1], [depth, depthShare], [labels, labelShare], [confidence, confidenceShare]];
  for (const [layer, share] of layers) {
    const [x, y, columns, rows] = layer === base ? [0, 0, 1, 1] : covered;
    const { width: w, height: h } = canvas;
    context.globalAlpha = share;
    context.globalCompositeOperation = layer === confidence ? "multiply" : "source-over";
    if (layer) context.drawImage(layer, x * w, y * h, columns * w, rows * h);
  }
  context.globalAlpha = 1;
  context.globalCompositeOperation = "source-over";
}

/** The classes that are in view, largest first. */
export function fillLegend(list, labels, classes) {
  const counts = new Uint32Array(256);
  for (const label of labels) counts[label]++;
  const present = [...counts.keys()].filter((label) => counts[label] > labels.length / 200);
  present.sort((a, b) => counts[b] - counts[a]);
  const key = present.join();
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...present.map((label) => legendItem(label, classes[label] ?? `class ${label}`)));
}

function legendItem(label, name) {
  const namespace = "http://www.w3.org/2000/svg";
  const item = document.createElement("li");
  const swatch = document.createElementNS(namespace, "svg");
  const square = document.createElementNS(namespace, "rect");
  square.setAttribute("width", "100%");
  square.setAttribute("height", "100%");
  square.setAttribute("fill", `rgb(${labelColor(label)})`);
  swatch.append(square);
  item.append(swatch, name);
  return item;
}
