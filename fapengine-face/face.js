// Draws the head with WebGL2 by the shaders of shaders/, as fapengine/render/renderer.py does. Edges are either fine,
// four samples a pixel, or soft: drawn into a texture first, found and softened on the way to the canvas.

import { boneMatrices, channelWeights, irisAndPupil, lidMargins, restShare, withRest } from "./deform.js";
import { cameraPosition, clipFromWorld, pixelsPerMm } from "./camera.js";

const FLOAT_BYTES = 4;
const DRAWN_BY_CPU = /llvmpipe|swiftshader|softpipe|software|basic render/i;
const MOST_OWN = 6; // contexts of views; browsers drop the oldest beyond 16 on a page, some beyond 8
const UNITS = { u_displacements: 0, u_normal_deltas: 1, u_skin: 2, u_picture: 0 };

let own = 0; // views with a context of their own
let shared = null; // canvas of all others, and their number

export class FaceView {
  // setup: what /setup.json holds of the shaders and how they are used. wall: linear RGB, or null for a clear ground.
  // rest: share of the pose at rest, 0 to 1, as a number or as text.
  constructor(canvas, head, setup, wall, rest = 1) {
    this.canvas = canvas;
    this.head = head;
    this.setup = setup;
    this.wall = wall;
    this.rest = restShare(rest);
    this.sharing = own >= MOST_OWN;
    if (this.sharing) shared ??= { canvas: document.createElement("canvas"), views: 0 };
    this.surface = this.sharing ? shared.canvas : canvas; // what is drawn on; if shared, it is copied to the canvas
    const options = { alpha: this.sharing || wall === null, antialias: false, depth: true, powerPreference: "high-performance" };
    this.gl = this.surface.getContext("webgl2", options);
    if (!this.gl) throw new Error("This browser has no WebGL2. Current browsers have it if hardware acceleration is enabled.");
    this.copy = this.sharing ? canvas.getContext("2d") : null;
    this.end = new AbortController();
    const { signal } = this.end;
    this.surface.addEventListener("webglcontextlost", (event) => this.lost(event), { signal });
    this.surface.addEventListener("webglcontextrestored", () => this.restored(), { signal });
    this.build();
    if (this.sharing) shared.views += 1;
    else own += 1;
  }

  lost(event) {
    event.preventDefault(); // else it never comes back
    if (this.sharing) this.canvas.dispatchEvent(new Event("webglcontextlost"));
  }

  restored() {
    this.build();
    if (this.sharing) this.canvas.dispatchEvent(new Event("webglcontextrestored"));
  }

  // Draw another head from now on.
  wear(head) {
    this.release();
    this.head = head;
    this.weights = this.bones = undefined;
    this.build();
  }

  release() {
    const { gl } = this;
    for (const { array } of this.arrays.values()) gl.deleteVertexArray(array);
    for (const { program } of this.programs.values()) gl.deleteProgram(program);
    for (const { buffer } of [{ buffer: this.vertices }, ...this.indices]) gl.deleteBuffer(buffer);
    for (const texture of [this.displacements, this.normalDeltas, this.skin]) gl.deleteTexture(texture);
    gl.deleteVertexArray(this.empty);
    this.target?.release();
  }

  // Gives the graphics card everything back.
  close() {
    this.end.abort();
    if (this.sharing) {
      this.release();
      shared.views -= 1;
      if (shared.views) return;
      shared = null;
    } else own -= 1;
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  build() {
    const { gl } = this;
    this.frugal = DRAWN_BY_CPU.test(this.renderer);
    this.programs = new Map();
    this.arrays = new Map();
    this.vertices = buffer(gl, gl.ARRAY_BUFFER, this.head.vertices.array);
    this.indices = Object.entries(this.head.parts).map(([part, triangles]) => {
      gl.bindVertexArray(null);
      return { part, buffer: buffer(gl, gl.ELEMENT_ARRAY_BUFFER, triangles), count: triangles.length };
    });
    this.empty = gl.createVertexArray();
    this.displacements = entries(gl, this.head.displacements);
    this.normalDeltas = entries(gl, this.head.normal_deltas);
    this.skin = this.head.skin ? painting(gl, this.head.skin) : null;
    this.level = null;
    // After a lost context nobody asks for the size again.
    this.target &&= makeTarget(gl, this.target.width, this.target.height, this.target.samples);
  }

  // Compiled when it is first wanted.
  program(name) {
    if (!this.programs.has(name)) this.programs.set(name, link(this.gl, name, this.setup.programs[name]));
    return this.programs.get(name);
  }

  // A part joined with the program that draws it.
  array({ part, buffer, count }, atVertices) {
    const key = `${part} ${atVertices}`;
    if (this.arrays.has(key)) return this.arrays.get(key);
    const kind = this.setup.parts[part];
    const painted = kind.may_be_painted && this.skin ? ["PAINTED"] : [];
    const lit = kind.may_be_lit_at_vertices && atVertices ? ["LIT_AT_VERTICES"] : [];
    const used = this.program([kind.program, ...painted, ...kind.definitions, ...lit].join(" "));
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.vertices);
    const stride = this.head.attributes.reduce((sum, [, size]) => sum + size, 0) * FLOAT_BYTES;
    let offset = 0;
    for (const [attribute, size] of this.head.attributes) {
      const place = gl.getAttribLocation(used.program, attribute);
      if (place >= 0) {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, offset);
      }
      offset += size * FLOAT_BYTES;
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bindVertexArray(null);
    const made = { ...used, array, count };
    this.arrays.set(key, made);
    return made;
  }

  resize(width, height, fineEdges) {
    const samples = fineEdges ? this.setup.fine_samples : 0;
    const { target, gl } = this;
    if (target && target.width === width && target.height === height && target.samples === samples) return;
    [this.canvas.width, this.canvas.height] = [width, height];
    if (this.sharing) {
      this.copy.globalCompositeOperation = "copy"; // a new size resets it
      for (const [side, wanted] of Object.entries({ width, height })) {
        if (this.surface[side] < wanted) this.surface[side] = wanted;
      }
    }
    target?.release();
    this.target = makeTarget(gl, width, height, samples);
  }

  // faps: 68 numbers, FAPU. camera: see camera.js.
  draw(faps, camera) {
    const { gl } = this;
    if (gl.isContextLost() || !this.target) return;
    const { width, height } = this.target;
    this.rested = withRest(faps, this.setup, this.rest, this.rested);
    this.weights = channelWeights(this.head, this.rested, this.weights);
    this.bones = boneMatrices(this.head, this.rested, this.bones);
    const clip = clipFromWorld(camera, width / height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.depthFunc(gl.LESS);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    bind(gl, UNITS.u_displacements, this.displacements);
    bind(gl, UNITS.u_normal_deltas, this.normalDeltas);
    if (this.skin) this.bindSkin(camera, height);
    const values = {
      u_channels: this.weights,
      u_bones: this.bones,
      u_clip_from_world: clip,
      u_eye_position: cameraPosition(camera),
      u_iris: irisAndPupil(this.head, this.rested),
      u_iris_albedo: this.head.irisAlbedo,
      u_lids: lidMargins(this.head, this.rested),
    };
    const atVertices = this.isLitAtVertices(camera, height);
    const inPart = ({ part }) => this.setup.parts[part].covers_in_part;
    for (const part of this.indices) if (!inPart(part)) this.drawPart(part, atVertices, values);
    gl.disable(gl.CULL_FACE);
    if (this.wall) this.cover("backdrop", { u_wall: this.wall, u_falloff: 1 });
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    for (const part of this.indices) if (inPart(part)) this.drawPart(part, atVertices, values);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    if (this.target.samples) this.resolve();
    else this.soften();
    if (this.sharing) this.copy.drawImage(this.surface, 0, this.surface.height - height, width, height, 0, 0, width, height);
  }

  drawPart(part, atVertices, values) {
    const { gl } = this;
    const { program, uniforms, array, count } = this.array(part, atVertices);
    gl.useProgram(program);
    for (const [name, set] of Object.entries(uniforms)) set(values[name]);
    gl.bindVertexArray(array);
    gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
  }

  // In two steps: the canvas may have another format, in which samples cannot be resolved.
  resolve() {
    const { gl, target } = this;
    const corners = [0, 0, target.width, target.height];
    for (const [from, to] of [[target.frame, target.resolved], [target.resolved, null]]) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
      gl.blitFramebuffer(...corners, ...corners, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
  }

  soften() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    bind(gl, UNITS.u_picture, this.target.picture);
    gl.depthFunc(gl.ALWAYS);
    this.cover("edges");
    gl.depthFunc(gl.GREATER); // edges.frag left depth 0 on edges alone
    this.cover("smooth");
  }

  // A CPU that draws is spared light at every pixel while vertices stand close, and the choice of the painting's level
  // for each; a graphics card does both in passing.
  isLitAtVertices(camera, height) {
    return this.frugal && this.head.edge * pixelsPerMm(camera, height) <= this.setup.max_fine_edge_px;
  }

  bindSkin(camera, height) {
    const { gl } = this;
    bind(gl, UNITS.u_skin, this.skin);
    if (!this.frugal) return;
    const finest = Math.floor(Math.log2(Math.max(...this.head.skin.shape.slice(0, 2))));
    const texelsPerPixel = Math.max(this.head.texelsPerMm, 1e-9) / pixelsPerMm(camera, height);
    const wanted = Math.floor(Math.log2(texelsPerPixel) + this.setup.skin_level_bias);
    const level = Math.min(Math.max(wanted, 0), finest);
    if (level === this.level) return;
    this.level = level;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_BASE_LEVEL, level);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAX_LEVEL, level);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
  }

  // One triangle over the whole picture.
  cover(name, values = {}) {
    const { gl } = this;
    const { program, uniforms } = this.program(name);
    gl.useProgram(program);
    for (const [key, set] of Object.entries(uniforms)) set(values[key]);
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  get renderer() {
    const names = this.gl.getExtension("WEBGL_debug_renderer_info");
    return this.gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : this.gl.RENDERER);
  }
}

function link(gl, name, { vertex, fragment }) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const stage = gl.createShader(kind);
    gl.shaderSource(stage, text);
    gl.compileShader(stage);
    gl.attachShader(program, stage);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const said = gl.getAttachedShaders(program).map((stage) => gl.getShaderInfoLog(stage));
    throw new Error(`shader ${name}: ${[gl.getProgramInfoLog(program), ...said].join(" ").trim()}`);
  }
  return { program, uniforms: setters(gl, program) };
}

// Name of each uniform that changes to what sets it; textures have their units once and for all.
function setters(gl, program) {
  const uniforms = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  gl.useProgram(program);
  for (let index = 0; index < count; ++index) {
    const { name, type } = gl.getActiveUniform(program, index);
    const key = name.replace("[0]", "");
    const place = gl.getUniformLocation(program, key);
    if (type === gl.SAMPLER_2D) gl.uniform1i(place, UNITS[key]);
    else if (type === gl.FLOAT_MAT4) uniforms[key] = (value) => gl.uniformMatrix4fv(place, false, value);
    else if (type === gl.FLOAT_VEC4) uniforms[key] = (value) => gl.uniform4fv(place, value);
    else if (type === gl.FLOAT_VEC3) uniforms[key] = (value) => gl.uniform3fv(place, value);
    else if (type === gl.FLOAT_VEC2) uniforms[key] = (value) => gl.uniform2fv(place, value);
    else uniforms[key] = (value) => gl.uniform1f(place, value);
  }
  return uniforms;
}

function buffer(gl, kind, data) {
  const made = gl.createBuffer();
  gl.bindBuffer(kind, made);
  gl.bufferData(kind, data, gl.STATIC_DRAW);
  return made;
}

function bind(gl, place, texture) {
  gl.activeTexture(gl.TEXTURE0 + place);
  gl.bindTexture(gl.TEXTURE_2D, texture);
}

function texture(gl, filter) {
  const made = gl.createTexture();
  bind(gl, 0, made);
  for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, filter);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
  return made;
}

function entries(gl, { array, shape: [rows, width] }) {
  const made = texture(gl, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, rows, 0, gl.RGBA, gl.FLOAT, array);
  return made;
}

function painting(gl, { array, shape: [height, width] }) {
  const made = texture(gl, gl.LINEAR);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, array);
  gl.generateMipmap(gl.TEXTURE_2D);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.REPEAT);
  return made;
}

// Where the face is drawn: into a picture, or with samples into buffers that are resolved into another.
function makeTarget(gl, width, height, samples) {
  const buffers = [];
  const frames = [];
  const frame = (attach) => {
    frames.push(gl.createFramebuffer());
    gl.bindFramebuffer(gl.FRAMEBUFFER, frames.at(-1));
    attach();
    return frames.at(-1);
  };
  const attachBuffer = (format, place, count) => {
    buffers.push(gl.createRenderbuffer());
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffers.at(-1));
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, count, format, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffers.at(-1));
  };
  const made = { width, height, samples, picture: null, resolved: null };
  if (samples) {
    made.resolved = frame(() => attachBuffer(gl.RGBA8, gl.COLOR_ATTACHMENT0, 0));
  } else {
    made.picture = texture(gl, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
  }
  made.frame = frame(() => {
    if (samples) attachBuffer(gl.RGBA8, gl.COLOR_ATTACHMENT0, samples);
    else gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.picture, 0);
    attachBuffer(gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT, samples);
  });
  made.release = () => {
    frames.forEach((one) => gl.deleteFramebuffer(one));
    buffers.forEach((one) => gl.deleteRenderbuffer(one));
    gl.deleteTexture(made.picture);
  };
  return made;
}
