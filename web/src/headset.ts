/** The picture of the camera on a virtual screen in a headset, and the pose of the headset. */

import { CanvasTexture, Mesh, MeshBasicMaterial, PerspectiveCamera, PlaneGeometry, Scene, SRGBColorSpace, WebGLRenderer } from "three";
import type { Quaternion } from "./protocol";

export interface HeadsetListener {
  pose(pose: Quaternion | null, stick: [number, number], clutch: boolean): void;
  select(): void;
  ended(): void;
}

/** Start the headset; return a sentence if that is not possible. */
export async function startHeadset(picture: HTMLCanvasElement, listener: HeadsetListener): Promise<string> {
  if (!navigator.xr) return "This browser does not support headsets; open the page in the browser of the headset.";
  if (!(await navigator.xr.isSessionSupported("immersive-vr"))) return "No headset was found.";
  const session = await navigator.xr.requestSession("immersive-vr", { optionalFeatures: ["local"] });
  const renderer = new WebGLRenderer({ antialias: true });
  renderer.xr.enabled = true;
  renderer.xr.setReferenceSpaceType("local");
  const scene = new Scene();
  const camera = new PerspectiveCamera(70, 1, 0.05, 20);
  const texture = new CanvasTexture(picture);
  texture.colorSpace = SRGBColorSpace;
  const screen = new Mesh(new PlaneGeometry(2.0, 1.5), new MeshBasicMaterial({ map: texture, toneMapped: false }));
  // The screen stays in front of the operator: the camera in the pipe turns instead.
  screen.position.z = -1.6;
  camera.add(screen);
  scene.add(camera);
  session.addEventListener("select", () => listener.select());
  session.addEventListener("end", () => {
    renderer.setAnimationLoop(null);
    renderer.dispose();
    listener.ended();
  });
  await renderer.xr.setSession(session);
  renderer.setAnimationLoop((_, frame) => {
    const space = renderer.xr.getReferenceSpace();
    const pose = frame && space ? frame.getViewerPose(space) : undefined;
    const q = pose?.transform.orientation;
    const [stick, clutch] = controllers(session);
    listener.pose(q ? [q.x, q.y, q.z, q.w] : null, stick, clutch);
    texture.needsUpdate = true;
    renderer.render(scene, camera);
  });
  return "";
}

/** Stick and grip of the controllers. */
function controllers(session: XRSession): [[number, number], boolean] {
  const stick: [number, number] = [0, 0];
  let clutch = false;
  for (const source of session.inputSources) {
    const axes = source.gamepad?.axes ?? [];
    stick[0] -= axes[3] ?? axes[1] ?? 0;
    stick[1] += axes[2] ?? axes[0] ?? 0;
    clutch ||= source.gamepad?.buttons[1]?.pressed ?? false;
  }
  return [stick, clutch];
}
