/** Input devices: mouse, keys, gamepad, phone and headset give a pose, a stick and a clutch. */

import { byId, now, type Quaternion } from "./protocol";

export interface Commands {
  pick(u: number, v: number): void;
  pickMiddle(): void;
  next(): void;
  /** Whether a candidate is selected; Enter then picks it. */
  choosing(): boolean;
  confirm(): void;
  mode(mode: "HEAD" | "TRACK" | "HOLD"): void;
  measure(): void;
  depth(): void;
  sharpen(): void;
  mark(): void;
  record(): void;
  take(): void;
}

export interface HeadPose {
  pose: Quaternion | null;
  age: number;
}

const DEGREE = Math.PI / 180;
const MOST = 70;
const TURNED_BY_KEYS = 30; // degrees a second
const DRAGGED = 0.12; // degrees a pixel
const STILL = 1.0; // s: browsers report the orientation of a phone only when it changes

/** Pose of a head that is turned right by yaw, then up by pitch, in degrees. */
export function turned(yaw: number, pitch: number): Quaternion {
  const [sy, cy] = [Math.sin((-yaw * DEGREE) / 2), Math.cos((-yaw * DEGREE) / 2)];
  const [sp, cp] = [Math.sin((pitch * DEGREE) / 2), Math.cos((pitch * DEGREE) / 2)];
  return [cy * sp, sy * cp, -sy * sp, cy * cp];
}

/** Pose of an operator who looks through a phone, from its alpha, beta and gamma in degrees. */
export function phonePose(alpha: number, beta: number, gamma: number, screen: number): Quaternion {
  const [x, y, z] = [(beta * DEGREE) / 2, (alpha * DEGREE) / 2, (-gamma * DEGREE) / 2];
  const [sx, cx, sy, cy, sz, cz] = [Math.sin(x), Math.cos(x), Math.sin(y), Math.cos(y), Math.sin(z), Math.cos(z)];
  // Turns about y, x and z, in this order.
  const device: Quaternion = [
    sx * cy * cz + cx * sy * sz,
    cx * sy * cz - sx * cy * sz,
    cx * cy * sz - sx * sy * cz,
    cx * cy * cz + sx * sy * sz,
  ];
  const half = Math.SQRT1_2;
  const camera = times(device, [-half, 0, 0, half]); // the camera looks out of the back
  const s = (-screen * DEGREE) / 2;
  return times(camera, [0, 0, Math.sin(s), Math.cos(s)]);
}

function times(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
}

export class Hands {
  source: "mouse" | "phone" | "headset" = "mouse";
  private yaw = 0;
  private pitch = 0;
  private readonly down = new Set<string>();
  private readonly padded: [number, number] = [0, 0];
  private clutched = false;
  private phone: { pose: Quaternion; at: number } | null = null;
  private headset: { pose: Quaternion | null; at: number; stick: [number, number]; clutch: boolean } | null = null;
  private buttons: boolean[] = [];
  private last = now();
  /** Called when the image is dragged. */
  dragged: () => void = () => {};

  constructor(
    private readonly commands: Commands,
    private readonly camera: HTMLCanvasElement,
  ) {
    this.listenToKeys();
    this.listenToPointer();
    this.listenToPad();
    const clutch = byId("clutch");
    const press = (on: boolean) => () => (this.clutched = on);
    clutch.addEventListener("pointerdown", press(true));
    clutch.addEventListener("keydown", (event) => {
      if (event.key === " " || event.key === "Enter") this.clutched = true;
    });
    for (const name of ["keyup", "blur"]) clutch.addEventListener(name, press(false));
    for (const name of ["pointerup", "pointerleave", "pointercancel"]) clutch.addEventListener(name, press(false));
    window.addEventListener("blur", () => this.down.clear());
  }

  /** Move on the virtual head and poll gamepads; call it at every tick. */
  tick(): void {
    const t = now();
    const passed = Math.min(t - this.last, 0.1);
    this.last = t;
    const right = this.held("arrowright") - this.held("arrowleft");
    const up = this.held("arrowup") - this.held("arrowdown");
    const [lookRight, lookUp] = this.pollGamepad();
    this.yaw = within(this.yaw + (right + lookRight) * TURNED_BY_KEYS * passed);
    this.pitch = within(this.pitch + (up + lookUp) * TURNED_BY_KEYS * passed);
  }

  /** Pose of the operator's head from the chosen device, and its age in seconds. */
  look(): HeadPose {
    if (this.source === "mouse") return { pose: turned(this.yaw, this.pitch), age: 0 };
    if (this.source === "phone") {
      if (!this.phone) return { pose: null, age: 0 };
      const age = now() - this.phone.at;
      return { pose: this.phone.pose, age: age < STILL ? 0 : age };
    }
    if (!this.headset) return { pose: null, age: 0 };
    return { pose: this.headset.pose, age: Math.max(now() - this.headset.at, 0) };
  }

  /** Forward and right, from -1 to 1. */
  stick(): [number, number] {
    const keys: [number, number] = [this.held("w") - this.held("s"), this.held("d") - this.held("a")];
    const headset = this.headset?.stick ?? [0, 0];
    return [0, 1].map((k) => clamp(keys[k]! + this.padded[k]! + this.gamepad[k]! + headset[k]!)) as [number, number];
  }

  clutch(): boolean {
    return this.clutched || this.down.has("c") || (this.buttons[5] ?? false) || (this.headset?.clutch ?? false);
  }

  /** Take in the pose of the headset in this frame; null if there is none. */
  headsetMoved(pose: Quaternion | null, stick: [number, number], clutch: boolean): void {
    const at = pose ? now() : (this.headset?.at ?? 0);
    this.headset = { pose: pose ?? this.headset?.pose ?? null, at, stick, clutch };
  }

  headsetEnded(): void {
    this.headset = null;
  }

  /** Start reading the orientation of this phone; return a sentence if that is not possible. */
  async usePhone(): Promise<string> {
    if (!("DeviceOrientationEvent" in window)) return "This browser does not report an orientation; choose another source.";
    if (!window.isSecureContext) return "Phones report their orientation over https only; start the console with --certificate.";
    const asking = DeviceOrientationEvent as unknown as { requestPermission?: () => Promise<string> };
    if (asking.requestPermission && (await asking.requestPermission()) !== "granted") {
      return "The phone refused access to its orientation.";
    }
    window.addEventListener("deviceorientation", (event) => {
      if (event.alpha === null || event.beta === null || event.gamma === null) return;
      const screen = window.screen.orientation?.angle ?? 0;
      this.phone = { pose: phonePose(event.alpha, event.beta, event.gamma, screen), at: now() };
    });
    return "";
  }

  private gamepad: [number, number] = [0, 0];

  private pollGamepad(): [number, number] {
    const pad = navigator.getGamepads?.().find((each) => each?.connected);
    if (!pad) {
      this.gamepad = [0, 0];
      this.buttons = [];
      return [0, 0];
    }
    const axis = (k: number) => pad.axes[k] ?? 0;
    this.gamepad = [-axis(1), axis(0)];
    const pressed = pad.buttons.map((button) => button.pressed);
    const fresh = (k: number) => pressed[k] && !this.buttons[k];
    if (fresh(0)) this.commands.pickMiddle();
    if (fresh(1)) this.commands.mode("TRACK");
    if (fresh(2)) this.commands.mode("HEAD");
    if (fresh(3)) this.commands.mode("HOLD");
    if (fresh(9)) this.commands.measure();
    if (fresh(8)) this.commands.depth();
    this.buttons = pressed;
    const quiet = (value: number) => (Math.abs(value) < 0.1 ? 0 : value);
    return [quiet(axis(2)), -quiet(axis(3))];
  }

  private held(key: string): number {
    return this.down.has(key) ? 1 : 0;
  }

  private listenToKeys(): void {
    let clicked = false;
    window.addEventListener("pointerdown", () => (clicked = true), true);
    // An element that was clicked must not keep the keyboard focus: the keys steer.
    const returnFocus = (event: Event) => {
      const used = event.target instanceof Element ? event.target.closest("button, select, input") : null;
      if (clicked && used && !document.querySelector("dialog[open]")) this.camera.focus({ preventScroll: true });
    };
    window.addEventListener("change", returnFocus);
    window.addEventListener("click", (event) => {
      if (event.target instanceof Element && event.target.closest("button")) returnFocus(event);
    });
    window.addEventListener("keydown", (event) => {
      clicked = false;
      if (event.ctrlKey || event.metaKey || event.altKey || isText(event.target)) return;
      if (document.querySelector("dialog[open]")) return;
      const key = event.key.toLowerCase();
      const tag = event.target instanceof HTMLElement ? event.target.tagName : "";
      if (/^(SELECT|INPUT)$/.test(tag) && key.startsWith("arrow")) return;
      const picks = key === "enter" && this.commands.choosing();
      if (/^(BUTTON|SELECT|A|INPUT)$/.test(tag) && !picks && (key === "enter" || key === " ")) return;
      if (picks) event.preventDefault(); // do not press the focused button, such as Release
      if (!event.repeat) this.once(key);
      if (key.startsWith("arrow")) event.preventDefault();
      this.down.add(key);
    });
    window.addEventListener("keyup", (event) => this.down.delete(event.key.toLowerCase()));
  }

  private once(key: string): void {
    const commands: Record<string, () => void> = {
      "1": () => this.commands.mode("HEAD"),
      "2": () => this.commands.mode("TRACK"),
      "3": () => this.commands.mode("HOLD"),
      escape: () => this.commands.mode("HOLD"),
      n: () => this.commands.next(),
      enter: () => this.commands.confirm(),
      m: () => this.commands.measure(),
      e: () => this.commands.depth(),
      f: () => this.commands.sharpen(),
      k: () => this.commands.mark(),
      r: () => this.commands.record(),
      t: () => this.commands.take(),
    };
    commands[key]?.();
  }

  /** Dragging turns the view as in a panorama; a click without a drag picks. */
  private listenToPointer(): void {
    let from: { x: number; y: number; far: boolean } | null = null;
    this.camera.addEventListener("pointerdown", (event) => {
      from = { x: event.clientX, y: event.clientY, far: false };
      this.camera.setPointerCapture(event.pointerId);
    });
    this.camera.addEventListener("pointermove", (event) => {
      if (!from) return;
      if (!from.far && Math.hypot(event.clientX - from.x, event.clientY - from.y) > 5) {
        from.far = true;
        this.dragged();
      }
      if (!from.far) return;
      this.yaw = within(this.yaw - event.movementX * DRAGGED);
      this.pitch = within(this.pitch + event.movementY * DRAGGED);
    });
    this.camera.addEventListener("pointerup", (event) => {
      if (from && !from.far) this.commands.pick(event.offsetX, event.offsetY);
      from = null;
    });
    this.camera.addEventListener("pointercancel", () => (from = null));
  }

  private listenToPad(): void {
    const pad = byId("pad");
    const knob = pad.firstElementChild as HTMLElement;
    const set = (x: number, y: number) => {
      this.padded[0] = -y;
      this.padded[1] = x;
      const reach = pad.clientWidth / 2 - knob.clientWidth / 2;
      knob.style.transform = `translate(${x * reach}px, ${y * reach}px)`;
    };
    const moved = (event: PointerEvent) => {
      const box = pad.getBoundingClientRect();
      const x = (2 * (event.clientX - box.left)) / box.width - 1;
      const y = (2 * (event.clientY - box.top)) / box.height - 1;
      const far = Math.max(Math.hypot(x, y), 1);
      set(x / far, y / far);
    };
    pad.addEventListener("pointerdown", (event) => {
      pad.setPointerCapture(event.pointerId);
      moved(event);
    });
    pad.addEventListener("pointermove", (event) => {
      if (pad.hasPointerCapture(event.pointerId)) moved(event);
    });
    for (const name of ["pointerup", "pointercancel"]) pad.addEventListener(name, () => set(0, 0));
  }
}

const clamp = (value: number): number => Math.min(Math.max(value, -1), 1);
const within = (degrees: number): number => Math.min(Math.max(degrees, -MOST), MOST);

function isText(target: EventTarget | null): boolean {
  return target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement && target.type === "text");
}
