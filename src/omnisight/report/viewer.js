"use strict";
// Viewer of a reconstruction in WebGL 2. World coordinates are relative to `origin` in the data.
(() => {
  const byId = (id) => document.getElementById(id);
  const data = JSON.parse(byId("reconstruction").textContent);
  const canvas = byId("scene"), details = byId("details"), select = byId("camera"), measure = byId("measure");
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) {
    details.append(line("p", "This browser has no WebGL 2.", "error"));
    return;
  }

  // --- Data ---
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const positions = new Float32Array(bytes(data.position)), colors = new Uint8Array(bytes(data.color));
  const index = new Uint32Array(bytes(data.index)), first = new Uint32Array(bytes(data.first));
  const observed = new Uint32Array(bytes(data.observed)), pixels = new Float32Array(bytes(data.pixel));
  const residuals = new Float32Array(bytes(data.residual));
  const pointAt = (k) => Array.from(positions.subarray(3 * k, 3 * k + 3));

  // --- Vectors ---
  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const norm = (a) => Math.hypot(a[0], a[1], a[2]);
  const unit = (a) => { const n = norm(a) || 1; return [a[0] / n, a[1] / n, a[2] / n]; };
  // 4 x 4 matrices by columns.
  const multiply = (a, b) => Float32Array.from({ length: 16 }, (_, k) => {
    let sum = 0;
    for (let j = 0; j < 4; j++) sum += a[(k & 3) + 4 * j] * b[j + (k & 12)];
    return sum;
  });
  const placed = (r, t, s) => [
    s * r[0], s * r[3], s * r[6], 0, s * r[1], s * r[4], s * r[7], 0, s * r[2], s * r[5], s * r[8], 0, ...t, 1];

  // --- The view: in orbit about a target, or from inside a camera ---
  const up = data.up, east = unit(cross(up, Math.abs(up[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), north = cross(up, east);
  const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];
  const centers = data.cameras.map((camera) => camera.position);
  const pointStep = 3 * Math.max(1, Math.floor(index.length / 5000)), sample = [];
  for (let k = 0; k < positions.length; k += pointStep) sample.push([positions[k], positions[k + 1], positions[k + 2]]);
  const every = [...sample, ...centers];
  const middle = every.length ? [0, 1, 2].map((k) => median(every.map((p) => p[k]))) : [0, 0, 0];
  const spread = every.length ? median(every.map((p) => norm(add(p, middle, -1)))) : 0;
  const extent = Math.max(spread, 3 * data.marker, 1e-9);
  const home = { target: middle, yaw: 0.7, pitch: -0.6, distance: 3 * extent, fov: 55 };
  const view = { ...home, inside: -1 };

  function frame() {
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    const level = add(north.map((x) => x * cy), east, sy);
    const forward = add(level.map((x) => x * cp), up, sp);
    const right = unit(cross(level, up));
    const eye = view.inside < 0 ? add(view.target, forward, -view.distance) : centers[view.inside];
    return { forward, right, upward: cross(right, forward), eye };
  }
  function viewMatrix(f, eye) {
    const [r, u, b] = [f.right, f.upward, f.forward.map((x) => -x)];
    return [r[0], u[0], b[0], 0, r[1], u[1], b[1], 0, r[2], u[2], b[2], 0, -dot(r, eye), -dot(u, eye), -dot(b, eye), 1];
  }
  function projection() {
    const f = 1 / Math.tan(view.fov * Math.PI / 360), aspect = canvas.width / canvas.height;
    const near = (view.inside < 0 ? Math.min(view.distance, extent) : data.marker) * 5e-3, far = 200 * extent + view.distance * 2;
    const [a, b] = [(far + near) / (near - far), 2 * far * near / (near - far)];
    return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, a, -1, 0, 0, b, 0];
  }
  function turnTo(point) {
    const d = unit(add(point, frame().eye, -1));
    view.pitch = Math.asin(Math.max(-0.999, Math.min(0.999, dot(d, up))));
    view.yaw = Math.atan2(dot(d, east), dot(d, north));
  }

  // --- Programs and buffers ---
  function program(vertex, fragment) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    ["position", "color"].forEach((name, place) => gl.bindAttribLocation(made, place, name));
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return { made, at: (name) => gl.getUniformLocation(made, name) };
  }
  const flat = program(`
    in vec3 position; in vec3 color; uniform mat4 matrix; uniform float size; out vec3 tone;
    void main() { gl_Position = matrix * vec4(position, 1.0); gl_PointSize = size; tone = color; }`, `
    in vec3 tone; out vec4 result; uniform bool round;
    void main() {
      if (round && distance(gl_PointCoord, vec2(0.5)) > 0.5) discard;
      result = vec4(tone, 1.0);
    }`);
  // The bearings of a grid over the image place its texture on the sphere: this is the camera model.
  const textured = program(`
    in vec3 position; in vec2 color; uniform mat4 matrix; out vec3 bearing; out vec2 place;
    void main() { gl_Position = matrix * vec4(position, 1.0); bearing = position; place = color; }`, `
    in vec3 bearing; in vec2 place; out vec4 result;
    uniform sampler2D image; uniform vec2 cosines; uniform vec3 tint; uniform float mixed;
    void main() {
      float cosine = normalize(bearing).z;
      if (cosine < cosines.x || cosine > cosines.y) discard;
      result = vec4(mix(texture(image, place).rgb, tint, mixed), 1.0);
    }`);
  function buffer(values, target = gl.ARRAY_BUFFER) {
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, values, target === gl.ARRAY_BUFFER ? gl.DYNAMIC_DRAW : gl.STATIC_DRAW);
    return made;
  }
  function attribute(place, source, size, type = gl.FLOAT, normalized = false) {
    gl.bindBuffer(gl.ARRAY_BUFFER, source);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, normalized, 0, 0);
  }
  const pointBuffer = buffer(positions), colorBuffer = buffer(colors);
  const sensors = data.sensors.map((sensor) => {
    const n = sensor.cells, bearings = new Float32Array(bytes(sensor.bearings)), corners = [], triangles = [];
    const valid = (k) => bearings[3 * k] !== 0 || bearings[3 * k + 1] !== 0 || bearings[3 * k + 2] !== 0;
    for (let row = 0; row <= n; row++) for (let column = 0; column <= n; column++) corners.push(column / n, row / n);
    for (let row = 0; row < n; row++) for (let column = 0; column < n; column++) {
      const k = row * (n + 1) + column, cell = [k, k + 1, k + n + 1, k + n + 2];
      if (cell.every(valid)) triangles.push(k, k + 1, k + n + 1, k + 1, k + n + 2, k + n + 1);
    }
    // The edges of the pyramid of a narrow image.
    const edges = [0, n, n * (n + 1), n * (n + 2)].filter(valid).map((k) => Array.from(bearings.subarray(3 * k, 3 * k + 3)));
    const narrow = edges.length === 4 && edges.every((edge) => edge[2] > 0.2);
    return {
      bearings: buffer(bearings), corners: buffer(new Float32Array(corners)), count: triangles.length,
      triangles: buffer(new Uint32Array(triangles), gl.ELEMENT_ARRAY_BUFFER), edges: narrow ? edges : [],
      cosines: [sensor.minCosine, sensor.maxCosine],
    };
  });
  const blank = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, blank);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([120, 140, 170, 255]));
  const textures = data.cameras.map((camera) => {
    if (camera.image === null) return blank;
    const texture = gl.createTexture(), image = new Image();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([60, 70, 85, 255]));
    image.onload = () => {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, image);
      gl.generateMipmap(gl.TEXTURE_2D);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      redraw();
    };
    image.src = camera.image;
    return texture;
  });

  // --- Drawing ---
  const state = { selected: -1, ends: [], pending: false };
  const linePositions = buffer(new Float32Array(0)), lineColors = buffer(new Float32Array(0));
  const markerScale = () => data.marker * Number(byId("camera-size").value) / 10;
  function redraw() {
    if (state.pending) return;
    state.pending = true;
    requestAnimationFrame(() => { state.pending = false; draw(); });
  }
  function draw() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.08, 0.094, 0.118, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const f = frame(), toScreen = projection(), matrix = multiply(toScreen, viewMatrix(f, f.eye));
    if (view.inside >= 0) {
      const camera = data.cameras[view.inside];
      gl.disable(gl.DEPTH_TEST);
      const turned = multiply(toScreen, viewMatrix(f, [0, 0, 0]));
      drawImage(view.inside, multiply(turned, placed(camera.rotation, [0, 0, 0], extent)), 0);
      gl.enable(gl.DEPTH_TEST);
    }
    // From inside a camera the others must not hide its image.
    const scale = markerScale() * (view.inside < 0 ? 1 : 0.25), segments = [], tones = [];
    const segment = (a, b, tone) => { segments.push(...a, ...b); tones.push(...tone, ...tone); };
    const seen = seenBy(state.selected);
    if (scale > 0) data.cameras.forEach((camera, k) => {
      // The eye is inside the cameras of the same rig, too.
      if (view.inside >= 0 && norm(add(camera.position, f.eye, -1)) < 4 * scale) return;
      drawImage(k, multiply(matrix, placed(camera.rotation, camera.position, scale)), seen.has(k) ? 0.35 : 0);
      const r = camera.rotation;
      for (const e of sensors[camera.sensor].edges) {
        const tip = [0, 1, 2].map((j) => camera.position[j] + scale * (r[3 * j] * e[0] + r[3 * j + 1] * e[1] + r[3 * j + 2] * e[2]));
        segment(camera.position, tip, [0.55, 0.62, 0.72]);
      }
    });
    gl.useProgram(flat.made);
    gl.uniformMatrix4fv(flat.at("matrix"), false, matrix);
    gl.uniform1i(flat.at("round"), 1);
    const size = Number(byId("point-size").value) * ratio;
    gl.uniform1f(flat.at("size"), size);
    attribute(0, pointBuffer, 3);
    attribute(1, colorBuffer, 3, gl.UNSIGNED_BYTE, true);
    if (size > 0) gl.drawArrays(gl.POINTS, 0, index.length);
    if (state.selected >= 0) {
      for (const k of seen) if (k !== view.inside) segment(pointAt(state.selected), centers[k], [1, 0.75, 0.2]);
    }
    if (state.ends.length === 2) segment(pointAt(state.ends[0]), pointAt(state.ends[1]), [0.3, 1, 0.6]);
    drawSimple(segments, tones, gl.LINES, 1);
    gl.disable(gl.DEPTH_TEST);
    const marked = [...(state.selected < 0 ? [] : [state.selected]), ...state.ends];
    drawSimple(marked.flatMap(pointAt), marked.flatMap((k) => (k === state.selected ? [1, 0.75, 0.2] : [0.3, 1, 0.6])),
      gl.POINTS, Math.max(9 * ratio, 2 * size));
  }
  function drawSimple(values, tones, mode, size) {
    if (!values.length) return;
    for (const [made, content] of [[linePositions, values], [lineColors, tones]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(content), gl.DYNAMIC_DRAW);
    }
    attribute(0, linePositions, 3);
    attribute(1, lineColors, 3);
    gl.uniform1f(flat.at("size"), size);
    gl.uniform1i(flat.at("round"), mode === gl.POINTS);
    gl.drawArrays(mode, 0, values.length / 3);
  }
  function drawImage(k, matrix, mixed) {
    const sensor = sensors[data.cameras[k].sensor];
    gl.useProgram(textured.made);
    gl.uniformMatrix4fv(textured.at("matrix"), false, matrix);
    gl.uniform2f(textured.at("cosines"), ...sensor.cosines);
    gl.uniform3f(textured.at("tint"), 1, 0.75, 0.2);
    gl.uniform1f(textured.at("mixed"), mixed);
    gl.bindTexture(gl.TEXTURE_2D, textures[k]);
    attribute(0, sensor.bearings, 3);
    attribute(1, sensor.corners, 2);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, sensor.triangles);
    gl.drawElements(gl.TRIANGLES, sensor.count, gl.UNSIGNED_INT, 0);
  }

  // --- Picking ---
  const seenBy = (k) => new Set(k < 0 ? [] : observed.subarray(first[k], first[k + 1]));
  function screenProjector() {
    const f = frame(), m = multiply(projection(), viewMatrix(f, f.eye));
    return (p) => {
      const w = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
      const x = (m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12]) / w;
      const y = (m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13]) / w;
      return w > 0 ? [(x + 1) / 2 * canvas.clientWidth, (1 - y) / 2 * canvas.clientHeight, w] : null;
    };
  }
  function pick(x, y) {
    const project = screenProjector(), scale = markerScale() * (view.inside < 0 ? 1 : 0.25);
    const focal = canvas.clientHeight / 2 / Math.tan(view.fov * Math.PI / 360), radius = 9;
    let camera = -1, depth = Infinity, point = -1, best = Infinity;
    centers.forEach((center, k) => {
      const at = k === view.inside || scale === 0 ? null : project(center);
      if (at && at[2] < depth && Math.hypot(at[0] - x, at[1] - y) < Math.max(6, focal * scale / at[2])) [camera, depth] = [k, at[2]];
    });
    for (let k = 0; k < index.length; k++) {
      const at = project(positions.subarray(3 * k, 3 * k + 3));
      if (!at) continue;
      // Of points at the same place on the screen, the nearest one.
      const score = Math.hypot(at[0] - x, at[1] - y) / radius + 0.1 * at[2] / (view.distance + extent);
      if (score < best && Math.hypot(at[0] - x, at[1] - y) < radius) [point, best] = [k, score];
    }
    return camera >= 0 && measure.ariaPressed !== "true" ? { camera } : { point };
  }

  // --- What is shown in the panel ---
  function line(tag, text, name = "") {
    const made = document.createElement(tag);
    made.textContent = text;
    made.className = name;
    return made;
  }
  function showPoint(k) {
    state.selected = k;
    const p = pointAt(k), list = line("div", "", "list");
    for (let j = first[k]; j < first[k + 1]; j++) {
      const button = line("button", "", "image"), camera = data.cameras[observed[j]], inside = observed[j];
      button.type = "button";
      button.title = camera.name;
      button.append(line("span", camera.name), line("span",
        `${pixels[2 * j].toFixed(1)}, ${pixels[2 * j + 1].toFixed(1)}; ${residuals[j].toFixed(2)} px`));
      button.addEventListener("click", () => { enter(inside); turnTo(p); redraw(); });
      list.append(button);
    }
    const count = first[k + 1] - first[k];
    details.replaceChildren(line("h2", `Point ${index[k]}: ${count} observations`), line("p", "Image: pixel; residual"), list);
    redraw();
  }
  function showDistance() {
    const [a, b] = state.ends.map(pointAt), text = norm(add(a, b, -1)).toPrecision(4);
    details.replaceChildren(line("h2", `Distance ${text} ${data.unit}`),
      line("p", `between the points ${index[state.ends[0]]} and ${index[state.ends[1]]}`));
  }
  function clicked(x, y) {
    const hit = pick(x, y);
    if (hit.camera !== undefined) enter(hit.camera);
    else if (measure.ariaPressed === "true" && hit.point >= 0) {
      state.ends = state.ends.length === 1 ? [...state.ends, hit.point] : [hit.point];
      if (state.ends.length === 2) showDistance();
      else details.replaceChildren(line("p", "Click the second point."));
    } else if (hit.point >= 0) showPoint(hit.point);
    redraw();
  }
  function enter(k) {
    const r = data.cameras[k].rotation;
    if (view.inside < 0) Object.assign(view, { fov: 90, distance: extent });
    view.inside = k;
    select.value = String(k);
    turnTo(add(centers[k], [r[2], r[5], r[8]]));
    if (state.selected < 0) details.replaceChildren(line("h2", data.cameras[k].name));
    redraw();
  }
  function leave() {
    if (view.inside >= 0) {
      Object.assign(view, { target: centers[view.inside], inside: -1, fov: home.fov, distance: extent });
      select.value = "-1";
    } else {
      Object.assign(state, { selected: -1, ends: [] });
      details.replaceChildren();
    }
    redraw();
  }

  // --- Input ---
  const held = new Map();
  let moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (held.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = held.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    moved += Math.abs(dx) + Math.abs(dy);
    if (held.size === 2) {
      const [p, q] = [...held.values()], other = p[0] === event.clientX && p[1] === event.clientY ? q : p;
      zoom(Math.hypot(last[0] - other[0], last[1] - other[1]) / Math.max(1, Math.hypot(event.clientX - other[0], event.clientY - other[1])));
    } else if (view.inside < 0 && (event.buttons & 2 || event.shiftKey)) {
      const f = frame(), step = 2 * view.distance * Math.tan(view.fov * Math.PI / 360) / canvas.clientHeight;
      view.target = add(add(view.target, f.right, -dx * step), f.upward, dy * step);
    } else {
      const step = view.inside < 0 ? 0.006 : -view.fov * Math.PI / 180 / canvas.clientHeight;
      view.yaw += dx * step;
      view.pitch = Math.max(-1.55, Math.min(1.55, view.pitch - dy * step));
    }
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => {
    if (held.delete(event.pointerId) && name === "pointerup" && moved < 4 && event.button === 0) clicked(event.offsetX, event.offsetY);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(event.deltaY * 0.0015)); }, { passive: false });
  function zoom(factor) {
    if (view.inside < 0) view.distance = Math.max(1e-3 * extent, Math.min(100 * extent, view.distance * factor));
    else view.fov = Math.max(10, Math.min(130, view.fov * factor));
    redraw();
  }
  const keys = new Set();
  window.addEventListener("keydown", (event) => {
    if (event.key === "Escape") leave();
    if (/^(SELECT|INPUT)$/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if ("wasdqe".includes(key) && key.length === 1 && !keys.has(key)) { keys.add(key); if (keys.size === 1) fly(performance.now()); }
  });
  window.addEventListener("keyup", (event) => keys.delete(event.key.toLowerCase()));
  window.addEventListener("blur", () => keys.clear());
  function fly(last) {
    requestAnimationFrame((now) => {
      if (!keys.size || view.inside >= 0) { keys.clear(); return; }
      const f = frame(), step = Math.max(0.3 * extent, view.distance) * Math.min(0.1, (now - last) / 1000);
      for (const [key, axis, sign] of [["w", f.forward, 1], ["s", f.forward, -1], ["d", f.right, 1], ["a", f.right, -1], ["e", up, 1], ["q", up, -1]])
        if (keys.has(key)) view.target = add(view.target, axis, sign * step);
      redraw();
      fly(now);
    });
  }
  data.cameras.forEach((camera, k) => { const made = line("option", camera.name); made.value = String(k); select.append(made); });
  select.addEventListener("change", () => { if (Number(select.value) >= 0) enter(Number(select.value)); else if (view.inside >= 0) leave(); });
  measure.addEventListener("click", () => {
    const on = measure.ariaPressed !== "true";
    measure.ariaPressed = String(on);
    canvas.classList.toggle("measure", on);
    Object.assign(state, { selected: -1, ends: [] });
    details.replaceChildren(...(on ? [line("p", "Click the first point.")] : []));
    redraw();
  });
  byId("reset").addEventListener("click", () => { Object.assign(view, home, { inside: -1 }); select.value = "-1"; redraw(); });
  for (const id of ["point-size", "camera-size"]) byId(id).addEventListener("input", redraw);
  window.addEventListener("resize", redraw);
  if (index.length < data.points) byId("figures").append(`; ${index.length} points with the most observations are shown`);
  // For scripts: where a point or a camera is on the page, px.
  window.viewer = { pointOnScreen: (k) => screenProjector()(pointAt(k)), cameraOnScreen: (k) => screenProjector()(centers[k]) };
  redraw();
})();
