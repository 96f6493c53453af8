// Draws the head with WebGL2 by the shaders of shaders/, as fapengine/render/renderer.py does: into a texture first,
// then edges are found and softened on the way to the canvas.

import { boneMatrices, channelWeights, irisAndPupil } from "./deform.js";
import { cameraPosition, clipFromWorld } from "./camera.js";

const FLOAT_BYTES = 4;

export class FaceView {
  // programs: { face: { vertex, fragment }, ... }, from /setup.json. wall: linear RGB, or null for a clear ground.
  constructor(canvas, head, programs, wall) {
    this.canvas = canvas;
    this.head = head;
    this.sources = programs;
    this.wall = wall;
    const options = { alpha: wall === null, antialias: false, depth: true, powerPreference: "high-performance" };
    this.gl = canvas.getContext("webgl2", options);
    if (!this.gl) throw new Error("This browser has no WebGL2; any current one has it, if its graphics are switched on.");
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.build());
    this.build();
  }

  build() {
    const { gl } = this;
    this.programs = Object.fromEntries(Object.entries(this.sources).map(([name, text]) => [name, link(gl, name, text)]));
    const vertices = buffer(gl, gl.ARRAY_BUFFER, this.head.vertices.array);
    this.parts = Object.entries(this.head.parts).map(([name, triangles]) => this.part(name, vertices, triangles));
    this.empty = gl.createVertexArray();
    this.moves = entries(gl, this.head.moves);
    this.turns = entries(gl, this.head.turns);
    this.skin = this.head.skin ? painting(gl, this.head.skin) : null;
    this.size = [0, 0];
  }

  // The program that draws a part: see PackedMesh.parts in fapengine/render/packing.py.
  programOf(part) {
    if (part === "eye") return this.programs.eye;
    const words = ["face", ...(this.head.skin ? ["PAINTED"] : []), ...(part === "card" ? ["CUT_OUT"] : [])];
    return this.programs[words.join(" ")];
  }

  part(name, vertices, triangles) {
    const { gl } = this;
    const used = this.programOf(name);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, vertices);
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
    buffer(gl, gl.ELEMENT_ARRAY_BUFFER, triangles);
    gl.bindVertexArray(null);
    return { ...used, array, count: triangles.length };
  }

  resize(width, height) {
    const { gl } = this;
    if (this.size[0] === width && this.size[1] === height) return;
    this.size = [width, height];
    [this.canvas.width, this.canvas.height] = this.size;
    if (this.target) {
      gl.deleteFramebuffer(this.target.frame);
      gl.deleteTexture(this.target.picture);
      gl.deleteRenderbuffer(this.target.depth);
    }
    this.target = target(gl, width, height);
  }

  // faps: 68 numbers, FAPU. camera: see camera.js.
  draw(faps, camera) {
    const { gl } = this;
    const [width, height] = this.size;
    if (gl.isContextLost() || !width || !height) return;
    this.weights = channelWeights(this.head, faps, this.weights);
    this.bones = boneMatrices(this.head, faps, this.bones);
    const clip = clipFromWorld(camera, width / height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.frame);
    gl.viewport(0, 0, width, height);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.depthFunc(gl.LESS);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    bind(gl, 0, this.moves);
    bind(gl, 1, this.turns);
    if (this.skin) bind(gl, 2, this.skin);
    for (const { program, uniforms, array, count } of this.parts) {
      gl.useProgram(program);
      gl.uniform4fv(uniforms.u_channels, this.weights);
      gl.uniformMatrix4fv(uniforms.u_bones, false, this.bones);
      gl.uniformMatrix4fv(uniforms.u_clip_from_world, false, clip);
      gl.uniform3fv(uniforms.u_eye_position, cameraPosition(camera));
      gl.uniform1i(uniforms.u_moves, 0);
      gl.uniform1i(uniforms.u_turns, 1);
      if (uniforms.u_skin) gl.uniform1i(uniforms.u_skin, 2);
      if (uniforms.u_iris) gl.uniform2fv(uniforms.u_iris, irisAndPupil(this.head, faps));
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
    }
    gl.disable(gl.CULL_FACE);
    if (this.wall) this.cover("backdrop", { u_wall: this.wall, u_falloff: 1 });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    bind(gl, 0, this.target.picture);
    gl.depthFunc(gl.ALWAYS);
    this.cover("edges", { u_picture: 0 });
    gl.depthFunc(gl.GREATER); // edges.frag left depth 0 on edges alone
    this.cover("smooth", { u_picture: 0 });
  }

  // One triangle over the whole picture.
  cover(name, values) {
    const { gl } = this;
    const { program, uniforms } = this.programs[name];
    gl.useProgram(program);
    for (const [key, value] of Object.entries(values)) {
      if (key === "u_picture") gl.uniform1i(uniforms[key], value);
      else if (Array.isArray(value)) gl.uniform3fv(uniforms[key], value);
      else gl.uniform1f(uniforms[key], value);
    }
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
  const uniforms = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
  for (let index = 0; index < count; ++index) {
    const key = gl.getActiveUniform(program, index).name.replace("[0]", "");
    uniforms[key] = gl.getUniformLocation(program, key);
  }
  return { program, uniforms };
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

function target(gl, width, height) {
  const picture = texture(gl, gl.LINEAR);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
  const depth = gl.createRenderbuffer();
  gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
  const frame = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
  return { picture, depth, frame };
}
