/** Three-dimensional view of the findings on a piece of the wall, seen from inside the pipe. */

import {
  AmbientLight, BackSide, BufferGeometry, CanvasTexture, CircleGeometry, Color, ConeGeometry, CylinderGeometry,
  DirectionalLight, DoubleSide, Float32BufferAttribute, Group, Mesh, MeshBasicMaterial, MeshStandardMaterial, PerspectiveCamera, RingGeometry, Scene, SRGBColorSpace,
  Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { ReportedFinding } from "./messages";

export class Solid {
  private readonly renderer = new WebGLRenderer({ antialias: true });
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(45, 1, 0.5, 500);
  private readonly controls: OrbitControls;
  private readonly wall = new MeshStandardMaterial({ side: BackSide, roughness: 0.55, metalness: 0.1, alphaTest: 0.5 });
  private readonly pipe: Mesh;
  private readonly marks = new Group();

  constructor(
    box: HTMLElement,
    private readonly radius: number,
  ) {
    box.replaceChildren(this.renderer.domElement);
    this.renderer.domElement.setAttribute("role", "img");
    this.renderer.domElement.setAttribute("aria-label", "Findings in three dimensions; drag to turn");
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene.background = new Color("#06080a");
    this.scene.add(new AmbientLight("#ffffff", 1.6));
    const sun = new DirectionalLight("#ffffff", 1.6);
    sun.position.set(-30, 60, 80);
    this.scene.add(sun, this.marks);
    // Its axis lies along x; the seam of the map is where phi is 0.
    this.pipe = new Mesh(new CylinderGeometry(radius, radius, 1, 96, 1, true), this.wall);
    this.scene.add(this.pipe);
    this.camera.position.set(-20, 26, 46);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.render());
    const resize = () => {
      const [width, height] = [box.clientWidth || 1, box.clientHeight || 1];
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      this.render();
    };
    new ResizeObserver(resize).observe(box);
    resize();
  }

  /** Show findings on the map of the wall between two z in mm. */
  show(findings: ReportedFinding[], bitmap: ImageBitmap | null, range: [number, number]): void {
    const [first, last] = range;
    const centre = findings.length ? findings.reduce((sum, f) => sum + f.z, 0) / findings.length : (first + last) / 2;
    this.pipe.scale.set(1, last - first, 1);
    this.pipe.rotation.set(0, 0, -Math.PI / 2);
    this.pipe.position.x = (first + last) / 2;
    if (bitmap) this.wall.map = this.texture(bitmap, findings, range);
    this.wall.needsUpdate = true;
    this.marks.clear();
    for (const finding of findings) this.marks.add(...(finding.patch ? [this.relief(finding.patch)] : this.mark(finding)));
    const head = new Mesh(new ConeGeometry(2, 5, 24), new MeshStandardMaterial({ color: "#ffb454" }));
    head.rotation.z = -Math.PI / 2;
    head.position.x = first + 10;
    this.marks.add(head);
    this.controls.target.set(centre, 0, 0);
    this.camera.position.set(centre - 26, 20, 40);
    const at = findings[findings.length - 1];
    if (at) {
      // From the far side of the axis, so that the newest finding is in front.
      const out = outward(at.phi);
      const far = this.radius * (at.patch ? 0.6 : -0.8); // from the axis: close to a relief, opposite to a mark
      this.camera.position.set(at.z - 3, out.y * far, out.z * far);
      this.controls.target.set(at.z, out.y * this.radius, out.z * this.radius);
    }
    this.controls.update();
    this.render();
  }

  /** The map, transparent where a relief replaces it. */
  private texture(bitmap: ImageBitmap, findings: ReportedFinding[], [first, last]: [number, number]): CanvasTexture {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [4 * bitmap.width, 4 * bitmap.height];
    const context = canvas.getContext("2d")!;
    context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    const round = 360 / (2 * Math.PI * this.radius); // degrees a millimetre
    for (const { patch } of findings) {
      if (!patch) continue;
      const [rows, columns] = [patch.depth.length, patch.depth[0]!.length];
      const x = ((((patch.phi % 360) + 360) % 360) / 360) * canvas.width;
      const y = ((patch.z - first) / (last - first)) * canvas.height;
      const width = (((columns - 1) * patch.step * round) / 360) * canvas.width;
      const height = (((rows - 1) * patch.step) / (last - first)) * canvas.height;
      context.clearRect(x, y, width, height);
      context.clearRect(x - canvas.width, y, width, height); // the part beyond the seam
    }
    this.wall.map?.dispose();
    const texture = new CanvasTexture(canvas);
    texture.colorSpace = SRGBColorSpace;
    texture.flipY = false; // the first row lies at the first z
    return texture;
  }

  /** The wall around a finding with its measured depth. */
  private relief(patch: NonNullable<ReportedFinding["patch"]>): Mesh {
    const rows = patch.depth.length;
    const columns = patch.depth[0]!.length;
    const grid = patch.depth.map((row) => [...row]);
    // A hole without a floor is drawn half as deep as its patch is long. This is for display only.
    for (const [i, j] of patch.through ?? []) grid[i]![j] = (rows * patch.step) / 2;
    const deepest = Math.max(0.1, ...grid.flat().map((depth) => depth ?? 0));
    const places: number[] = [];
    const colours: number[] = [];
    const faces: number[] = [];
    const [wall, deep, open] = [new Color("#aab4ba"), new Color("#d8502c"), new Color("#303840")];
    grid.forEach((row, i) =>
      row.forEach((depth, j) => {
        const phi = patch.phi + ((j * patch.step) / this.radius) * (180 / Math.PI);
        const at = outward(phi).multiplyScalar(this.radius + (depth ?? 0));
        places.push(patch.z + i * patch.step, at.y, at.z);
        const colour = depth === null ? open : wall.clone().lerp(deep, Math.min(Math.max(depth / deepest, 0), 1));
        colours.push(colour.r, colour.g, colour.b);
        if (i + 1 < rows && j + 1 < columns) {
          const a = i * columns + j;
          faces.push(a, a + columns, a + 1, a + 1, a + columns, a + columns + 1);
        }
      }),
    );
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute(places, 3));
    geometry.setAttribute("color", new Float32BufferAttribute(colours, 3));
    geometry.setIndex(faces);
    geometry.computeVertexNormals();
    return new Mesh(geometry, new MeshStandardMaterial({ vertexColors: true, side: DoubleSide, roughness: 0.7 }));
  }

  /** A dark disc of the measured size on the wall, with a ring around it. */
  private mark(finding: ReportedFinding): Mesh[] {
    const out = outward(finding.phi);
    const place = new Vector3(finding.z, 0, 0).addScaledVector(out, this.radius - 0.06);
    const hole = new Mesh(
      new CircleGeometry(finding.diameter / 2, 40),
      new MeshBasicMaterial({ color: "#000000", side: 2 }),
    );
    const ring = new Mesh(
      new RingGeometry(finding.diameter / 2 + 0.25, finding.diameter / 2 + 0.55, 48),
      new MeshBasicMaterial({ color: "#46d6b8", side: 2 }),
    );
    for (const mesh of [hole, ring]) {
      mesh.position.copy(place);
      mesh.lookAt(new Vector3(finding.z, 0, 0));
    }
    return [hole, ring];
  }

  private render(): void {
    this.renderer.render(this.scene, this.camera);
  }
}

/** The direction from the axis to the wall at an angle in degrees; y of the pipe points down. */
function outward(phi: number): Vector3 {
  const a = (phi * Math.PI) / 180;
  return new Vector3(0, -Math.sin(a), Math.cos(a));
}
