// The 3D view from outside: viser runs in a frame of this origin and shows its camera and its nodes on `window`.
//
// Everything here is this browser's own: another viewer's camera, layers and point size stay as they are, and nothing
// goes through the server. Points are in the estimate's world, in m.

export type Point = [number, number, number];
export type Layer = "map" | "estimate" | "truth" | "body" | "camera";
/** What the view is doing, from its first byte to its first frame. */
export type Stage = "program" | "scene" | "frame" | "drawn";

const NODES: Record<Layer, string[]> = {
  map: ["/map"],
  estimate: ["/estimate"],
  truth: ["/truth"],
  body: ["/robot", "/heading"],
  camera: ["/camera"],
};
const FINE_WITHIN_M = 2;
/** The points of far chunks grow with the distance between them, up to so much. */
const MOST_GROWTH = 4;
/** So many points are drawn however slow the machine is. */
const FEWEST_POINTS = 6000;
const PICK_PX = 10;
/** Triangles of a frame that has no body in it yet, at most: a link alone has 144. */
const WITHOUT_BODY = 1000;

// The part of three.js and viser that is used.
interface Vector {
  x: number;
  y: number;
  z: number;
  clone(): Vector;
  set(x: number, y: number, z: number): Vector;
  project(camera: Camera): Vector;
  unproject(camera: Camera): Vector;
}
interface Matrix {
  elements: number[];
}
interface Node3 {
  visible: boolean;
  parent: Node3 | null;
  children: Node3[];
  position: Vector;
  matrixWorld: Matrix;
  isPoints?: boolean;
  geometry?: Geometry;
  material?: { uniforms?: { scale?: { value: number } } };
  localToWorld(v: Vector): Vector;
  worldToLocal(v: Vector): Vector;
}
interface Geometry {
  attributes: { position?: { count: number; getX(i: number): number; getY(i: number): number; getZ(i: number): number } };
  drawRange: { count: number };
  setDrawRange(start: number, count: number): void;
}
interface Camera extends Node3 {
  fov: number;
  aspect: number;
  projectionMatrix: Matrix;
  matrixWorldInverse: Matrix;
}
interface Controls {
  getTarget(v: Vector): Vector;
  getPosition(v: Vector): Vector;
  setPosition(x: number, y: number, z: number, smooth: boolean): void;
  setTarget(x: number, y: number, z: number, smooth: boolean): void;
}
interface Viser {
  camera: Camera | null;
  cameraControl: Controls | null;
  canvas: HTMLCanvasElement | null;
  nodeRefFromName: Record<string, Node3 | undefined>;
  requestRender(): void;
}
interface ViewerWindow extends Window {
  __viserMutable?: Viser;
  __viserTestpoints?: { rendererInfo?: { render?: { frame: number; triangles: number } } };
  /** Share of the points that this machine draws quickly enough, by viewer-frame.ts. */
  snakeslamDetail?: number;
}

export interface Drawn {
  shown: number;
  total: number;
}

export class Scene3D {
  private readonly hidden = new Set<Layer>();
  private readonly governed = new WeakSet<Node3>();
  private laidOut = "";
  /** The program that has drawn; another one, after loading again, has not. */
  private drawnBy: Viser | null = null;
  pointSizeM = 0.016;
  /** A robot is known: a frame without it is not the first one. */
  expectsBody = false;

  constructor(private readonly frame: HTMLIFrameElement) {}

  get stage(): Stage {
    const window = this.window;
    if (!window?.__viserMutable) return "program";
    if (!this.root) return "scene";
    if (this.drawnBy === window.__viserMutable) return "drawn";
    const triangles = window.__viserTestpoints?.rendererInfo?.render?.triangles ?? 0;
    if (triangles <= (this.expectsBody ? WITHOUT_BODY : 0)) {
      window.__viserMutable.requestRender();
      return "frame";
    }
    this.drawnBy = window.__viserMutable;
    return "drawn";
  }

  /** Whether the camera can be moved. */
  get ready(): boolean {
    return this.viser?.camera != null && this.viser.cameraControl != null && this.root !== null;
  }

  get target(): Point | null {
    const camera = this.viser?.camera;
    return camera && this.ready ? this.toWorld(this.viser!.cameraControl!.getTarget(camera.position.clone())) : null;
  }

  get position(): Point | null {
    const camera = this.viser?.camera;
    return camera && this.ready ? this.toWorld(this.viser!.cameraControl!.getPosition(camera.position.clone())) : null;
  }

  /** The half of the smaller field of view, in rad. */
  get halfView(): number {
    const camera = this.viser?.camera;
    if (!camera) return 0.4;
    const half = (camera.fov * Math.PI) / 360;
    return Math.min(half, Math.atan(Math.tan(half) * camera.aspect));
  }

  /** Metres that one CSS pixel shows at the point looked at. */
  get metresPerPixel(): number | null {
    const [from, to] = [this.position, this.target];
    const height = this.frame.clientHeight;
    const camera = this.viser?.camera;
    if (!from || !to || !camera || height === 0) return null;
    return (2 * distance(from, to) * Math.tan((camera.fov * Math.PI) / 360)) / height;
  }

  moveCamera(from: Point, to: Point): void {
    const controls = this.viser?.cameraControl;
    if (!controls || !this.ready) return;
    const [a, b] = [this.toThree(from), this.toThree(to)];
    controls.setPosition(a.x, a.y, a.z, false);
    controls.setTarget(b.x, b.y, b.z, false);
  }

  /** Move the camera along, however the operator has turned it. */
  shift(by: Point): void {
    const [from, to] = [this.position, this.target];
    if (from && to) this.moveCamera(plus(from, by), plus(to, by));
  }

  show(layer: Layer, shown: boolean): void {
    if (shown) this.hidden.delete(layer);
    else this.hidden.add(layer);
    this.laidOut = "";
    this.govern();
    this.viser?.requestRender();
  }

  /** viser sets a node's visibility in each frame: the property itself says no while its layer is off. */
  private govern(): void {
    for (const [layer, names] of Object.entries(NODES) as [Layer, string[]][])
      for (const name of names) {
        const node = this.viser?.nodeRefFromName[name];
        if (!node || this.governed.has(node)) continue;
        this.governed.add(node);
        let own = node.visible;
        Object.defineProperty(node, "visible", {
          configurable: true,
          get: () => own && !this.hidden.has(layer),
          set: (value: boolean) => (own = value),
        });
      }
  }

  /**
   * Draw the map finely near `centre` and coarsely far from it: the points of a chunk come coarse to fine.
   * Return how many points are drawn of how many there are.
   */
  layOut(centre: Point): Drawn {
    this.govern();
    const viser = this.viser;
    const camera = viser?.camera;
    const drawn = { shown: 0, total: 0 };
    if (!viser || !camera || !viser.canvas) return drawn;
    const clouds = [...this.clouds()];
    const known = clouds.reduce((sum, { count }) => sum + count, 0);
    const detail = Math.max(this.window?.snakeslamDetail ?? 1, FEWEST_POINTS / Math.max(known, 1));
    const unit = viser.canvas.height / Math.tan((camera.fov * Math.PI) / 360);
    for (const { node, points, count } of clouds) {
      const away = Math.max(1, distance(this.toWorldOf(node), centre) / FINE_WITHIN_M);
      const share = Math.min(1, detail / away ** 2);
      const shown = Math.ceil(count * share);
      drawn.total += count;
      drawn.shown += shown;
      if (points.geometry!.drawRange.count !== shown) points.geometry!.setDrawRange(0, shown);
      const scale = points.material?.uniforms?.scale;
      if (scale) scale.value = this.pointSizeM * Math.min(MOST_GROWTH, Math.sqrt(count / shown)) * unit;
    }
    if (this.hidden.has("map")) drawn.shown = 0;
    const layout = JSON.stringify([drawn, this.pointSizeM, unit]);
    if (layout !== this.laidOut) viser.requestRender();
    this.laidOut = layout;
    return drawn;
  }

  /** Where the chunks of the map are. */
  get chunkPlaces(): Point[] {
    return [...this.clouds()].map(({ node }) => this.toWorldOf(node));
  }

  /** A point of the world in CSS pixels of the frame; null behind the camera. */
  project(point: Point): [number, number] | null {
    const camera = this.viser?.camera;
    if (!camera || !this.ready) return null;
    const v = this.toThree(point).project(camera);
    if (v.z > 1) return null;
    return [((v.x + 1) / 2) * this.frame.clientWidth, ((1 - v.y) / 2) * this.frame.clientHeight];
  }

  /** The map's point drawn nearest to the eye within a few pixels of (x, y), else the floor's there; null for the sky. */
  pick(x: number, y: number): Point | null {
    const camera = this.viser?.camera;
    if (!camera || !this.ready) return null;
    const { clientWidth: width, clientHeight: height } = this.frame;
    const view = times(camera.projectionMatrix.elements, camera.matrixWorldInverse.elements);
    let best: Vector | null = null;
    let nearest = Infinity;
    if (!this.hidden.has("map"))
      for (const { points } of this.clouds()) {
        const at = points.geometry!.attributes.position!;
        const m = times(view, points.matrixWorld.elements);
        for (let i = 0; i < points.geometry!.drawRange.count && i < at.count; i++) {
          const [px, py, pz] = [at.getX(i), at.getY(i), at.getZ(i)];
          const w = row(m, 3, px, py, pz);
          if (w <= 0 || w >= nearest) continue;
          const dx = ((row(m, 0, px, py, pz) / w + 1) / 2) * width - x;
          const dy = ((1 - row(m, 1, px, py, pz) / w) / 2) * height - y;
          if (dx * dx + dy * dy > PICK_PX ** 2) continue;
          nearest = w;
          best = points.localToWorld(camera.position.clone().set(px, py, pz));
        }
      }
    return best ? this.toWorld(best) : this.floorAt((2 * x) / width - 1, 1 - (2 * y) / height);
  }

  private floorAt(x: number, y: number): Point | null {
    const camera = this.viser!.camera!;
    const from = this.position!;
    const to = this.toWorld(camera.position.clone().set(x, y, 0.5).unproject(camera));
    const floor = this.viser!.nodeRefFromName["/grid"]?.position.z ?? 0;
    const along = (floor - from[2]) / (to[2] - from[2]);
    if (!(along > 0) || along > 1e5) return null;
    return [from[0] + along * (to[0] - from[0]), from[1] + along * (to[1] - from[1]), floor];
  }

  private *clouds(): Generator<{ node: Node3; points: Node3; count: number }> {
    for (const [name, node] of Object.entries(this.viser?.nodeRefFromName ?? {})) {
      if (!node || !name.startsWith("/map/")) continue;
      const points = find(node);
      const count = points?.geometry?.attributes.position?.count ?? 0;
      if (points && count > 0) yield { node, points, count };
    }
  }

  private get window(): ViewerWindow | null {
    // The browser's own page of an error is of another origin: nothing on its window may be asked for.
    return this.frame.contentDocument ? (this.frame.contentWindow as ViewerWindow | null) : null;
  }

  private get viser(): Viser | null {
    return this.window?.__viserMutable ?? null;
  }

  /** The node whose axes are the world's: three.js has y up. */
  private get root(): Node3 | null {
    return this.viser?.nodeRefFromName["/grid"]?.parent ?? null;
  }

  private toThree(p: Point): Vector {
    return this.root!.localToWorld(this.viser!.camera!.position.clone().set(...p));
  }

  private toWorld(v: Vector): Point {
    const p = this.root!.worldToLocal(v);
    return [p.x, p.y, p.z];
  }

  private toWorldOf(node: Node3): Point {
    return [node.position.x, node.position.y, node.position.z];
  }
}

function find(node: Node3): Node3 | null {
  if (node.isPoints) return node;
  for (const child of node.children) {
    const found = find(child);
    if (found) return found;
  }
  return null;
}

export function distance(a: Point, b: Point): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

export function plus(a: Point, b: Point): Point {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

/** The product of two matrices in columns, as three.js has them. */
function times(a: number[], b: number[]): number[] {
  return Array.from({ length: 16 }, (_, i) => {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[(i % 4) + 4 * k]! * b[4 * Math.floor(i / 4) + k]!;
    return sum;
  });
}

function row(m: number[], r: number, x: number, y: number, z: number): number {
  return m[r]! * x + m[r + 4]! * y + m[r + 8]! * z + m[r + 12]!;
}
