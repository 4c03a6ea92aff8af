// The model of the first visit, made on the spot: a candle on a table, and three spheres that show metal and gloss.
// Everything is a surface of revolution: a list of smooth curves of [radius, height], from the bottom up.

const AROUND = 64;

/** Curve along a circle: centre, radius, from and to in degrees (0 is outwards, 90 is up). */
function arc([r, y], radius, from, to, steps) {
  return Array.from({ length: steps + 1 }, (_, i) => {
    const angle = ((from + ((to - from) * i) / steps) * Math.PI) / 180;
    const across = r + radius * Math.cos(angle);
    return [Math.abs(across) < 1e-9 ? 0 : across, y + radius * Math.sin(angle)];
  });
}

const sphere = (radius) => [arc([0, radius], radius, -90, 90, 32)];

const TABLE = [
  [
    [0.62, -0.03],
    [0.62, -0.004],
  ],
  arc([0.616, -0.004], 0.004, 0, 90, 6),
  [
    [0.616, 0],
    [0, 0],
  ],
];

const DISH = [
  [
    [0.045, 0],
    [0.078, 0.012],
  ],
  arc([0.077, 0.0145], 0.0025, -75, 120, 12),
  [
    [0.0758, 0.0167],
    [0.046, 0.006],
    [0, 0.006],
  ],
];

const WAX = [
  [
    [0.03, 0.006],
    [0.03, 0.126],
  ],
  arc([0.026, 0.126], 0.004, 0, 90, 8),
  [
    [0.026, 0.13],
    [0.012, 0.128],
    [0, 0.127],
  ],
];

const WICK = [
  [
    [0.0016, 0.127],
    [0.0014, 0.143],
  ],
  [
    [0.0014, 0.143],
    [0, 0.143],
  ],
];

/** A drop: round below, pointed above. */
const FLAME = [
  Array.from({ length: 33 }, (_, i) => {
    const t = i / 32;
    return [i === 0 || i === 32 ? 0 : 0.0105 * Math.sin(Math.PI * t ** 0.62) * (1 - 0.25 * t), 0.139 + 0.046 * t];
  }),
];

const MATERIALS = [
  { name: "Table", color: [0.28, 0.16, 0.1], roughness: 0.42 },
  { name: "Brass", color: [0.87, 0.64, 0.3], roughness: 0.2, metallic: 1 },
  { name: "Wax", color: [0.85, 0.79, 0.66], roughness: 0.55 },
  { name: "Wick", color: [0.02, 0.02, 0.02], roughness: 0.9 },
  { name: "Flame", color: [0, 0, 0], roughness: 1, emissive: [1, 0.56, 0.2], strength: 120 },
  { name: "Silver", color: [0.95, 0.94, 0.92], roughness: 0.05, metallic: 1 },
  { name: "Jade", color: [0.06, 0.3, 0.2], roughness: 0.15 },
  { name: "Clay", color: [0.5, 0.16, 0.09], roughness: 0.9 },
];

const OBJECTS = [
  { name: "Table", shape: TABLE, material: 0, at: [0, 0, 0] },
  { name: "Dish", shape: DISH, material: 1, at: [0, 0, 0] },
  { name: "Candle", shape: WAX, material: 2, at: [0, 0, 0] },
  { name: "Wick", shape: WICK, material: 3, at: [0, 0, 0] },
  { name: "Flame", shape: FLAME, material: 4, at: [0, 0, 0] },
  { name: "Silver sphere", shape: sphere(0.05), material: 5, at: [0.15, 0, -0.05] },
  { name: "Jade sphere", shape: sphere(0.036), material: 6, at: [-0.13, 0, 0.03] },
  { name: "Clay sphere", shape: sphere(0.026), material: 7, at: [0.085, 0, 0.1] },
];

/** Unit normal (radial, up) at point `i` of a curve that runs upwards around its outside. */
function curveNormal(curve, i) {
  const [r0, y0] = curve[Math.max(i - 1, 0)];
  const [r1, y1] = curve[Math.min(i + 1, curve.length - 1)];
  const size = Math.hypot(r1 - r0, y1 - y0);
  return [(y1 - y0) / size, (r0 - r1) / size];
}

/** Turns curves about +y into a triangle mesh. */
function revolve(curves) {
  const mesh = { positions: [], normals: [], triangles: [] };
  for (const curve of curves) {
    const first = mesh.positions.length / 3;
    curve.forEach(([r, y], i) => {
      const [across, up] = curveNormal(curve, i);
      for (let j = 0; j <= AROUND; j += 1) {
        const [s, c] = [Math.sin((2 * Math.PI * j) / AROUND), Math.cos((2 * Math.PI * j) / AROUND)];
        mesh.positions.push(r * s, y, r * c);
        mesh.normals.push(across * s, up, across * c);
      }
    });
    for (let i = 0; i + 1 < curve.length; i += 1) {
      for (let j = 0; j < AROUND; j += 1) {
        const a = first + i * (AROUND + 1) + j;
        const d = a + AROUND + 1;
        if (curve[i][0] > 0) mesh.triangles.push(a, a + 1, d + 1);
        if (curve[i + 1][0] > 0) mesh.triangles.push(a, d + 1, d);
      }
    }
  }
  return mesh;
}

/** Collects arrays into one buffer, with a view and an accessor each. */
class Buffer {
  #chunks = [];
  #length = 0;
  views = [];
  accessors = [];

  /** Index of the new accessor; `width` numbers make one element. */
  push(array, { type, componentType, target, width, bounds }) {
    this.views.push({ buffer: 0, byteOffset: this.#length, byteLength: array.byteLength, target });
    const accessor = { bufferView: this.views.length - 1, componentType, type, count: array.length / width };
    if (bounds) {
      const lane = (k) => array.filter((_, i) => i % width === k);
      const ends = (pick) => Array.from({ length: width }, (_, k) => lane(k).reduce((a, b) => pick(a, b)));
      Object.assign(accessor, { min: ends(Math.min), max: ends(Math.max) });
    }
    this.accessors.push(accessor);
    this.#chunks.push(new Uint8Array(array.buffer));
    this.#length += array.byteLength;
    return this.accessors.length - 1;
  }

  bytes() {
    const all = new Uint8Array(this.#length);
    this.#chunks.reduce((at, chunk) => (all.set(chunk, at), at + chunk.length), 0);
    return all;
  }
}

const FLOATS = { type: "VEC3", componentType: 5126, target: 34962, width: 3 };
const INDICES = { type: "SCALAR", componentType: 5125, target: 34963, width: 1 };

function gltfMesh(buffer, { name, shape, material }) {
  const { positions, normals, triangles } = revolve(shape);
  const attributes = {
    POSITION: buffer.push(new Float32Array(positions), { ...FLOATS, bounds: true }),
    NORMAL: buffer.push(new Float32Array(normals), FLOATS),
  };
  return { name, primitives: [{ attributes, indices: buffer.push(new Uint32Array(triangles), INDICES), material }] };
}

function gltfMaterial({ name, color, roughness, metallic = 0, emissive, strength }) {
  const surface = { baseColorFactor: [...color, 1], metallicFactor: metallic, roughnessFactor: roughness };
  const glow = emissive && {
    emissiveFactor: emissive,
    extensions: { KHR_materials_emissive_strength: { emissiveStrength: strength } },
  };
  return { name, pbrMetallicRoughness: surface, ...glow };
}

/** A quaternion that tilts about +x. */
const pitched = (degrees) => [Math.sin((degrees * Math.PI) / 360), 0, 0, Math.cos((degrees * Math.PI) / 360)];

function gltf() {
  const buffer = new Buffer();
  const meshes = OBJECTS.map((object) => gltfMesh(buffer, object));
  const nodes = OBJECTS.map(({ name, at }, mesh) => ({ name, mesh, translation: at }));
  nodes.push({ name: "Front", camera: 0, translation: [0, 0.19, 0.55], rotation: pitched(-13) });
  const bytes = buffer.bytes();
  const json = {
    asset: { version: "2.0", generator: "Candela demo" },
    extensionsUsed: ["KHR_materials_emissive_strength"],
    scene: 0,
    scenes: [{ name: "Candle", nodes: nodes.map((_, i) => i) }],
    nodes,
    meshes,
    materials: MATERIALS.map(gltfMaterial),
    cameras: [{ name: "Front", type: "perspective", perspective: { yfov: 0.56, znear: 0.01 } }],
    accessors: buffer.accessors,
    bufferViews: buffer.views,
    buffers: [{ byteLength: bytes.length }],
  };
  return { json, bytes };
}

/** A GLB chunk: length, type, content padded to four bytes with `filler`. */
function chunk(type, content, filler) {
  const padded = new Uint8Array(Math.ceil(content.length / 4) * 4).fill(filler);
  padded.set(content);
  return [new Uint32Array([padded.length, type]), padded];
}

/** The model as a file. */
export function demoFile() {
  const { json, bytes } = gltf();
  const body = [
    ...chunk(0x4e4f534a, new TextEncoder().encode(JSON.stringify(json)), 0x20),
    ...chunk(0x004e4942, bytes, 0),
  ];
  const length = body.reduce((sum, part) => sum + part.byteLength, 12);
  return new File([new Uint32Array([0x46546c67, 2, length]), ...body], "candle.glb", { type: "model/gltf-binary" });
}

/** The light that goes with it: dusk. */
export const DEMO_ENVIRONMENT = {
  kind: "gradient",
  gradient: { top: [0.2, 0.3, 0.5], horizon: [0.45, 0.35, 0.3], bottom: [0.05, 0.04, 0.04] },
  intensity: 0.6,
};
