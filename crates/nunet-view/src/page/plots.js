// Small plots of the last values.

const MOST = 150;

export class Plot {
  constructor(canvas) {
    this.canvas = canvas;
    this.lines = new Map();
  }

  /** Adds a value to a line; `color` names a variable of the style sheet. */
  add(line, value, color) {
    if (!this.lines.has(line)) this.lines.set(line, { values: [], color });
    const { values } = this.lines.get(line);
    values.push(value);
    if (values.length > MOST) values.shift();
  }

  clear() {
    this.lines.clear();
  }

  draw() {
    const { canvas } = this;
    const lines = [...this.lines.values()];
    const scale = devicePixelRatio;
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    // A canvas does not understand `light-dark()`; the computed color of an element is resolved.
    const colorOf = (name) => {
      canvas.style.color = `var(${name})`;
      return getComputedStyle(canvas).color;
    };
    context.clearRect(0, 0, width, height);
    const top = niceAbove(Math.max(...lines.flatMap((line) => line.values), 1));
    context.fillStyle = colorOf("--quiet");
    context.font = `${11 * scale}px system-ui, sans-serif`;
    context.fillText(String(top), 4 * scale, 13 * scale);
    context.fillText("0", 4 * scale, height - 4 * scale);
    for (const { values, color } of lines) {
      context.strokeStyle = colorOf(color);
      context.lineWidth = 1.5 * scale;
      context.beginPath();
      values.forEach((value, i) => {
        const x = width - ((values.length - 1 - i) * width) / MOST;
        context.lineTo(x, height - 2 - ((height - 4) * value) / top);
      });
      context.stroke();
    }
  }
}

/** 1, 2 or 5 times a power of ten. */
function niceAbove(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * power).find((step) => step >= value);
}
