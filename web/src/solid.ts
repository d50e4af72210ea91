/** The findings in three dimensions: a piece of the pipe's wall from inside, with what was measured. */

import {
  AmbientLight, BackSide, CanvasTexture, CircleGeometry, Color, ConeGeometry, CylinderGeometry, DirectionalLight,
  Group, Mesh, MeshBasicMaterial, MeshStandardMaterial, PerspectiveCamera, RingGeometry, Scene, SRGBColorSpace,
  Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Finding } from "./talk";

export class Solid {
  private readonly renderer = new WebGLRenderer({ antialias: true });
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(45, 1, 1, 500);
  private readonly controls: OrbitControls;
  private readonly wall = new MeshStandardMaterial({ side: BackSide, roughness: 0.55, metalness: 0.1 });
  private readonly pipe: Mesh;
  private readonly marks = new Group();

  constructor(
    box: HTMLElement,
    private readonly radius: number,
  ) {
    box.replaceChildren(this.renderer.domElement);
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
  show(findings: Finding[], bitmap: ImageBitmap | null, range: [number, number]): void {
    const [first, last] = range;
    const centre = findings.length ? findings.reduce((sum, f) => sum + f.z, 0) / findings.length : (first + last) / 2;
    this.pipe.scale.set(1, last - first, 1);
    this.pipe.rotation.set(0, 0, -Math.PI / 2);
    this.pipe.position.x = (first + last) / 2;
    if (bitmap) this.wall.map = this.texture(bitmap);
    this.wall.needsUpdate = true;
    this.marks.clear();
    for (const finding of findings) this.marks.add(...this.mark(finding));
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
      this.camera.position.set(at.z - 16, -out.y * 26 + 4, -out.z * 26);
    }
    this.controls.update();
    this.render();
  }

  private texture(bitmap: ImageBitmap): CanvasTexture {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
    const context = canvas.getContext("2d")!;
    context.drawImage(bitmap, 0, 0);
    this.wall.map?.dispose();
    const texture = new CanvasTexture(canvas);
    texture.colorSpace = SRGBColorSpace;
    texture.flipY = false; // the first row lies at the first z
    return texture;
  }

  /** A dark disc of the size that was measured, on the wall, with a ring round it. */
  private mark(finding: Finding): Mesh[] {
    const out = outward(finding.phi);
    const place = new Vector3(finding.z, 0, 0).addScaledVector(out, this.radius - 0.06);
    const hole = new Mesh(
      new CircleGeometry(finding.diameter / 2, 40),
      new MeshBasicMaterial({ color: finding.bright ? "#ffffff" : "#000000", side: 2 }),
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
