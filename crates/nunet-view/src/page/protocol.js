// Binary frames of the WebSocket. The layout is described in the book, page "Live view".

export const SECTION = { image: 1, depth: 2, labels: 3, obstacles: 4, confidence: 5 };
export const UNITS = { none: 0, metre: 1, relative: 2 };
const VERSION = 1;

/** Reads a message. Maps are unpacked by `unpackDepth` and `unpackBytes`. */
export function parseFrame(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 80 || view.getUint32(0, false) !== 0x4e555646) throw new Error("not a frame");
  if (view.getUint16(4, true) !== VERSION) throw new Error("a frame of another version");
  return {
    sequence: Number(view.getBigUint64(8, true)),
    captureMs: Number(view.getBigInt64(16, true)) / 1e6,
    latencyMs: view.getUint32(24, true) / 1000,
    depthWidth: view.getUint16(28, true),
    depthHeight: view.getUint16(30, true),
    width: view.getUint16(32, true),
    height: view.getUint16(34, true),
    stride: view.getUint16(36, true),
    units: view.getUint8(38),
    near: view.getFloat32(40, true),
    far: view.getFloat32(44, true),
    isLogarithmic: view.getUint8(48) === 1,
    first: view.getFloat32(52, true),
    step: view.getFloat32(56, true),
    // Left, top, width, height of the part that depth covers, as shares of the image.
    view: [0, 1, 2, 3].map((index) => view.getFloat32(64 + 4 * index, true)),
    bytes: buffer.byteLength,
    sections: sections(buffer, view),
  };
}

/** The bytes of each section by its kind; kinds that nobody knows are harmless. */
function sections(buffer, view) {
  const found = new Map();
  let at = view.getUint16(6, true);
  while (at + 8 <= buffer.byteLength) {
    const length = view.getUint32(at + 4, true);
    if (at + 8 + length > buffer.byteLength) throw new Error("a section is cut off");
    found.set(view.getUint32(at, true), new Uint8Array(buffer, at + 8, length));
    at += 8 + Math.ceil(length / 4) * 4;
  }
  return found;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** One byte per pixel, row by row: `SECTION.labels` or `SECTION.confidence`. */
export async function unpackBytes(frame, section) {
  const bytes = frame.sections.get(section);
  return bytes ? inflate(bytes) : null;
}

/** Depth, row by row; 0 where there is no measurement (metric depth is never 0). */
export async function unpackDepth(frame) {
  const bytes = frame.sections.get(SECTION.depth);
  if (!bytes) return null;
  const planes = await inflate(bytes);
  const { width, height } = frame;
  const count = width * height;
  if (planes.length !== 2 * count) throw new Error("a depth map of another size");
  const codes = new Uint16Array(count);
  const values = new Float32Array(count);
  const table = levels(frame);
  for (let y = 0, i = 0; y < height; y++) {
    for (let x = 0; x < width; x++, i++) {
      const number = planes[i] | (planes[count + i] << 8);
      const difference = (number >> 1) ^ -(number & 1);
      const code = (codes[i] = difference + prediction(codes, i, x, y, width));
      values[i] = code & 0xffff ? table(codes[i]) : NaN;
    }
  }
  return values;
}

const STATES = ["unknown", "free", "occupied", "drop"];

/** Sectors and points of obstacles, meters in the robot's base frame (x forward, y left); null without obstacles. */
export function unpackObstacles(frame) {
  const bytes = frame.sections.get(SECTION.obstacles);
  if (!bytes) return null;
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const sectorCount = view.getUint16(0, true);
  const pointCount = view.getUint16(2, true);
  const firstPoint = 16 + 8 * sectorCount;
  if (bytes.length !== firstPoint + 8 * pointCount) throw new Error("obstacles of another length");
  const angleMin = view.getFloat32(4, true);
  const angleStep = view.getFloat32(8, true);
  const sectors = Array.from({ length: sectorCount }, (_, i) => {
    const at = 16 + 8 * i;
    return {
      start: angleMin + i * angleStep,
      end: angleMin + (i + 1) * angleStep,
      range: view.getFloat32(at, true),
      state: STATES[view.getUint8(at + 4)] ?? "unknown",
      label: view.getUint8(at + 5),
      isRemembered: view.getUint8(at + 6) !== 0,
    };
  });
  const points = Array.from({ length: pointCount }, (_, i) => {
    const [x, y, height] = [0, 2, 4].map((offset) => view.getInt16(firstPoint + 8 * i + offset, true) / 100);
    return { x, y, height };
  });
  return { sectors, points, maxRange: view.getFloat32(12, true) };
}

/** Code to depth. Logarithmic curves need an exponential per value, so these are kept. */
function levels({ isLogarithmic, first, step }) {
  if (!isLogarithmic) return (code) => first + (code - 1) * step;
  const known = [];
  return (code) => (known[code] ??= first * Math.exp((code - 1) * step));
}

/** The median edge detector of LOCO-I; neighbors outside the map are 0. */
function prediction(codes, i, x, y, width) {
  if (y === 0) return x === 0 ? 0 : codes[i - 1];
  const above = codes[i - width];
  if (x === 0) return above;
  const left = codes[i - 1];
  const diagonal = codes[i - width - 1];
  const least = Math.min(left, above);
  const greatest = Math.max(left, above);
  if (diagonal >= greatest) return least;
  if (diagonal <= least) return greatest;
  return left + above - diagonal;
}
