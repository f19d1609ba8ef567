// The depth map as points in 3D. Positions are computed on the graphics card: ray times depth.

const VERTEX = `#version 300 es
in vec2 ray;
in float depth;
uniform mat3 rotation;
uniform vec3 center;
uniform float distance_m;
uniform vec2 focal;
uniform float spacing_px;
uniform ivec2 size;
uniform vec4 part;
uniform sampler2D colors;
out vec3 color;
void main() {
  vec3 point = rotation * (vec3(ray, 1.0) * depth - center);
  point.z += distance_m;
  vec2 pixel = vec2(gl_VertexID % size.x, gl_VertexID / size.x);
  color = texture(colors, part.xy + part.zw * (pixel + 0.5) / vec2(size)).rgb;
  bool isPoint = depth > 0.0 && point.z > 0.02;
  float near = 0.02, far = 400.0;
  float z = (far + near) / (far - near) * point.z - 2.0 * far * near / (far - near);
  gl_Position = isPoint ? vec4(point.xy * focal * vec2(1.0, -1.0), z, point.z) : vec4(2.0, 2.0, 2.0, 1.0);
  gl_PointSize = clamp(1.3 * spacing_px * depth / point.z, 1.5, 24.0);
}`;

const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 color;
out vec4 result;
void main() { result = vec4(color, 1.0); }`;

const FIELD_OF_VIEW = 0.9; // Radians, vertically.
const START = { yaw: -0.35, pitch: 0.2, zoom: 1 };

export class Cloud {
  constructor(canvas) {
    this.canvas = canvas;
    this.view = { ...START };
    this.center = [0, 0, 2];
    this.count = 0;
    // preserveDrawingBuffer: copies and screenshots of the canvas show what is on the screen.
    this.gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (this.gl) this.prepare();
    this.listen();
  }

  /** Why there is no cloud; empty if there is one. */
  get problem() {
    return this.gl ? "" : "This browser has no WebGL 2.";
  }

  prepare() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    this.rays = this.attribute(program, "ray", 2);
    this.depth = this.attribute(program, "depth", 1);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
    }
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
      gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    }
    this.uniform = (name) => gl.getUniformLocation(program, name);
  }

  attribute(program, name, parts) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    const location = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, parts, gl.FLOAT, false, 0, 0);
    return buffer;
  }

  fill(buffer, values, usage) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, values, usage);
  }

  /** New depth, with the grid of rays of its camera, a canvas of colors, and the part of it that depth covers. */
  update(depth, frame, grid, colors, part) {
    if (!this.gl) return;
    const { gl } = this;
    const key = `${frame.width} ${frame.height} ${frame.stride} ${frame.depthWidth}`;
    if (this.grid !== grid || this.key !== key) {
      [this.grid, this.key] = [grid, key];
      const rays = raysOf(frame, grid);
      this.spacing = Math.abs(rays[2] - rays[0]) || 0.01;
      this.fill(this.rays, rays, gl.STATIC_DRAW);
      this.center = [0, 0, (frame.near + frame.far) / 2];
    }
    this.size = [frame.width, frame.height];
    this.part = part;
    this.count = depth.length;
    this.fill(this.depth, depth, gl.DYNAMIC_DRAW);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, colors);
    this.draw();
  }

  draw() {
    const { gl, canvas, view } = this;
    if (!gl || !this.count) return;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.04, 0.05, 0.07, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const focal = 1 / Math.tan(FIELD_OF_VIEW / 2);
    gl.uniformMatrix3fv(this.uniform("rotation"), false, rotation(view));
    gl.uniform3fv(this.uniform("center"), this.center);
    gl.uniform1f(this.uniform("distance_m"), (this.center[2] * 1.25) / view.zoom);
    gl.uniform2f(this.uniform("focal"), (focal * height) / width, focal);
    gl.uniform1f(this.uniform("spacing_px"), (this.spacing * focal * height) / 2);
    gl.uniform2iv(this.uniform("size"), this.size);
    gl.uniform4fv(this.uniform("part"), this.part);
    gl.drawArrays(gl.POINTS, 0, this.count);
  }

  rotate(yaw, pitch) {
    this.view.yaw += yaw;
    this.view.pitch = Math.max(-1.5, Math.min(1.5, this.view.pitch + pitch));
    this.draw();
  }

  zoom(factor) {
    this.view.zoom = Math.max(0.1, Math.min(20, this.view.zoom * factor));
    this.draw();
  }

  reset() {
    this.view = { ...START };
    this.draw();
  }

  listen() {
    const { canvas } = this;
    const pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    const end = (event) => pointers.delete(event.pointerId);
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      pointers.set(event.pointerId, event);
      const apart = (a, b) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
      if (other) this.zoom(apart(event, other) / Math.max(apart(before, other), 1));
      else this.rotate((event.clientX - before.clientX) / 200, (event.clientY - before.clientY) / 200);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 500));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.press(event));
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  press(event) {
    const actions = {
      ArrowLeft: () => this.rotate(-0.1, 0),
      ArrowRight: () => this.rotate(0.1, 0),
      ArrowUp: () => this.rotate(0, -0.1),
      ArrowDown: () => this.rotate(0, 0.1),
      "+": () => this.zoom(1.2),
      "=": () => this.zoom(1.2),
      "-": () => this.zoom(1 / 1.2),
      0: () => this.reset(),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  }
}

/** Turned about the vertical axis, then about the horizontal one; columns one after the other. */
function rotation({ yaw, pitch }) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return [cy, -sp * sy, -cp * sy, 0, cp, -sp, sy, sp * cy, cp * cy];
}

/** The ray of each pixel of the map, between the nodes of the grid. Pixels without a ray have NaN and are not drawn. */
function raysOf({ width, height, stride, depthWidth, depthHeight }, { columns, rows, rays }) {
  const values = new Float32Array(2 * width * height);
  for (let y = 0, i = 0; y < height; y++) {
    const [j, v] = node(y * stride, depthHeight, rows);
    for (let x = 0; x < width; x++, i += 2) {
      const [k, u] = node(x * stride, depthWidth, columns);
      for (let part = 0; part < 2; part++) {
        const at = (row, column) => rays[row * columns + column][part] ?? NaN;
        const upper = at(j, k) * (1 - u) + at(j, k + 1) * u;
        const lower = at(j + 1, k) * (1 - u) + at(j + 1, k + 1) * u;
        values[i + part] = upper * (1 - v) + lower * v;
      }
    }
  }
  return values;
}

/** The node before a pixel, and the share of the way to the next one; beyond the first and the last node, the line goes on. */
function node(pixel, pixels, nodes) {
  const place = ((pixel + 0.5) * nodes) / pixels - 0.5;
  const before = Math.max(0, Math.min(nodes - 2, Math.floor(place)));
  return [before, place - before];
}
