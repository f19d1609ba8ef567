// The robot's surroundings from above: forward is up, left is left.

const HALF = Math.PI / 2;
// The same colors as `obstacles.png` of `nunetd infer --obstacles`.
const COLORS = {
  free: "#78c878",
  unseen: "#969696",
  occupied: "#c81e1e",
  remembered: "#8c50a0",
  drop: "#f0961e",
  ring: "#5a5a5a",
  point: "#3c0000",
};

/** Draws obstacles from above into a canvas. */
export function paintObstacles(canvas, obstacles) {
  const scale = Math.min(devicePixelRatio, 2);
  const width = Math.round(canvas.clientWidth * scale);
  const height = Math.round(canvas.clientHeight * scale);
  if (!width || !height) return;
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, width, height);
  const place = placing(obstacles, width, height);
  context.translate(place.x, place.y);
  paintSectors(context, obstacles, place.pxPerM);
  paintPoints(context, obstacles.points, place.pxPerM, scale);
  paintRings(context, obstacles, place.pxPerM, scale);
}

/** Where the robot is, and the scale: everything within `maxRange` in view is visible. */
function placing({ sectors, maxRange }, width, height) {
  const seesBehind = sectors.some(({ start, end }) => start < -HALF - 0.01 || end > HALF + 0.01);
  const sides = sectors.flatMap(({ start, end }) => [start, end]).map((angle) => Math.abs(Math.sin(angle)));
  // Half of the view's width as a share of the range, with room for the rings' labels.
  const side = seesBehind ? 1 : Math.max(0.3, ...sides) * 1.05;
  const pxPerM = Math.min(width / 2 / side, seesBehind ? height / 2 : height * 0.93) / maxRange;
  return { x: width / 2, y: seesBehind ? height / 2 : height * 0.97, pxPerM };
}

/** A ring segment from `near` to `far`. Angles of the robot are counterclockwise from forward. */
function segment(context, { start, end }, near, far) {
  const turned = (angle) => -HALF - angle;
  context.beginPath();
  context.arc(0, 0, far, turned(start), turned(end), true);
  context.arc(0, 0, near, turned(end), turned(start), false);
  context.closePath();
  context.fill();
  // Without an outline, thin seams remain between neighboring sectors.
  context.strokeStyle = context.fillStyle;
  context.lineWidth = 1;
  context.stroke();
}

function paintSectors(context, { sectors, maxRange }, pxPerM) {
  for (const sector of sectors) {
    const range = Math.min(sector.range, maxRange) * pxPerM;
    context.fillStyle = COLORS.unseen;
    segment(context, sector, range, maxRange * pxPerM);
    context.fillStyle = COLORS.free;
    segment(context, sector, 0, range);
    if (sector.state !== "occupied" && sector.state !== "drop") continue;
    context.fillStyle = COLORS[sector.isRemembered ? "remembered" : sector.state];
    segment(context, sector, range, range + 0.06 * maxRange * pxPerM);
  }
}

function paintPoints(context, points, pxPerM, scale) {
  context.fillStyle = COLORS.point;
  for (const { x, y } of points) context.fillRect(-y * pxPerM - scale / 2, -x * pxPerM - scale / 2, scale, scale);
}

function paintRings(context, { maxRange }, pxPerM, scale) {
  context.strokeStyle = context.fillStyle = COLORS.ring;
  context.lineWidth = scale / 2;
  context.font = `${10 * scale}px system-ui, sans-serif`;
  for (let meters = 1; meters <= maxRange; meters++) {
    context.beginPath();
    context.arc(0, 0, meters * pxPerM, 0, 2 * Math.PI);
    context.stroke();
    context.fillText(`${meters} m`, 3 * scale, -meters * pxPerM - 2 * scale);
  }
}

/** The nearest obstacle or drop in words, for the caption and for screen readers. */
export function describeObstacles({ sectors }, classes) {
  const ends = sectors.filter(({ state }) => state === "occupied" || state === "drop");
  if (!ends.length) return "none seen";
  const nearest = ends.reduce((a, b) => (b.range < a.range ? b : a));
  const degrees = Math.round((90 / HALF) * ((nearest.start + nearest.end) / 2));
  const side = degrees > 0 ? "left" : "right";
  const direction = degrees === 0 ? "ahead" : `${Math.abs(degrees)}° ${side}`;
  const name = nearest.state === "drop" ? "drop" : (classes[nearest.label] ?? "obstacle");
  return `${name} at ${nearest.range.toFixed(2)} m, ${direction}`;
}
