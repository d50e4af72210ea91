/** The picture of the camera with its overlays. */

import type { Hello, LoopState } from "./messages";
import type { Picture } from "./protocol";

const ACCENT = "#46d6b8";
const WARM = "#ffb454";
const BLUE = "#6cb6ff";

export class Stage {
  /** Index of the candidate that the keyboard has selected; -1 for none. */
  chosen = -1;
  private bitmap: ImageBitmap | null = null;
  private decoding = false;
  private readonly context: CanvasRenderingContext2D;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d", { alpha: false })!;
  }

  /** Show a picture, unless nobody can see it or the previous one is still being decoded. */
  async show(picture: Picture, state: LoopState | null, hello: Hello | null): Promise<boolean> {
    if (this.decoding || document.hidden || this.canvas.clientWidth === 0) return false;
    this.decoding = true;
    try {
      const bitmap = await createImageBitmap(picture.jpeg);
      this.bitmap?.close();
      this.bitmap = bitmap;
    } catch {
      return false;
    } finally {
      this.decoding = false;
    }
    this.draw(state, hello);
    return true;
  }

  /** The pixel of the camera at a position on the canvas. */
  pixel(x: number, y: number, hello: Hello): [number, number] {
    const { width, height } = this.canvas;
    const scale = Math.min(this.canvas.clientWidth / width, this.canvas.clientHeight / height);
    const left = (this.canvas.clientWidth - width * scale) / 2;
    const top = (this.canvas.clientHeight - height * scale) / 2;
    const u = (((x - left) / scale) * hello.view.width) / width;
    const v = (((y - top) / scale) * hello.view.height) / height;
    return [Math.min(Math.max(u, 0), hello.view.width - 1), Math.min(Math.max(v, 0), hello.view.height - 1)];
  }

  private draw(state: LoopState | null, hello: Hello | null): void {
    const { context, canvas, bitmap } = this;
    if (!bitmap) return;
    context.imageSmoothingQuality = "high";
    context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
    if (!state || !hello) return;
    const scale = canvas.width / hello.view.width;
    const ui = Math.min(Math.max(1, canvas.width / (canvas.clientWidth || canvas.width)), 2.6);
    this.drawHorizon(hello, state);
    state.spots.forEach(([u, v, diameter], k) => {
      const size = Math.max(diameter * scale, 14 * ui);
      context.strokeStyle = k === this.chosen ? "#fff" : WARM;
      context.lineWidth = (k === this.chosen ? 2.5 : 1.2) * ui;
      corners(context, u * scale, v * scale, size);
      context.fillStyle = WARM;
      context.font = `600 ${12 * ui}px system-ui, sans-serif`;
      context.fillText(String(k + 1), u * scale + size * 0.75 + 8 * ui, v * scale - size * 0.75);
    });
    if (state.target) {
      const [u, v, , visible] = state.target;
      context.strokeStyle = visible ? ACCENT : "#ff6b6b";
      context.lineWidth = 2 * ui;
      circle(context, u * scale, v * scale, 18 * ui);
      cross(context, u * scale, v * scale, 28 * ui, 12 * ui);
    }
    context.strokeStyle = "#ffffff80";
    context.lineWidth = 1;
    const [u, v] = hello.view.centre; // the optical axis, where a target is centred
    cross(context, u * scale, v * scale, 14, 5);
    this.drawCone(hello, state);
  }

  /** Lines that stay level with the base of the head: where pan and tilt are zero. */
  private drawHorizon(hello: Hello, state: LoopState): void {
    const { context, canvas } = this;
    const scale = canvas.width / hello.view.width;
    const [pan, tilt] = state.angle;
    if (pan === null || tilt === null) return;
    const focal = hello.view.focal * scale;
    const x = hello.view.centre[0] * scale - focal * Math.tan((pan * Math.PI) / 180);
    const y = hello.view.centre[1] * scale + focal * Math.tan((tilt * Math.PI) / 180);
    context.strokeStyle = "#6cb6ff66";
    context.setLineDash([10, 8]);
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(0, y);
    context.lineTo(canvas.width, y);
    context.moveTo(x, 0);
    context.lineTo(x, canvas.height);
    context.stroke();
    context.setLineDash([]);
  }

  /** A small dial: the cone, the command and where the head is. */
  private drawCone(hello: Hello, state: LoopState): void {
    const { context, canvas } = this;
    const [r, x, y] = [58, canvas.width - 76, 76];
    const scale = r / hello.cone;
    context.fillStyle = "#0c1013aa";
    context.beginPath();
    context.arc(x, y, r + 8, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = BLUE;
    context.lineWidth = 1.5;
    circle(context, x, y, r);
    context.strokeStyle = "#6cb6ff55";
    cross(context, x, y, r, 0);
    const at = (pan: number, tilt: number, colour: string, size: number) => {
      context.fillStyle = colour;
      context.beginPath();
      context.arc(x + pan * scale, y - tilt * scale, size, 0, 2 * Math.PI);
      context.fill();
    };
    at(state.command[0], state.command[1], WARM, 5);
    if (state.angle[0] !== null && state.angle[1] !== null) at(state.angle[0], state.angle[1], ACCENT, 4);
  }
}

function circle(context: CanvasRenderingContext2D, x: number, y: number, r: number): void {
  context.beginPath();
  context.arc(x, y, r, 0, 2 * Math.PI);
  context.stroke();
}

function cross(context: CanvasRenderingContext2D, x: number, y: number, far: number, near: number): void {
  context.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
    context.moveTo(x + dx * near, y + dy * near);
    context.lineTo(x + dx * far, y + dy * far);
  }
  context.stroke();
}

function corners(context: CanvasRenderingContext2D, x: number, y: number, size: number): void {
  const [half, arm] = [size * 0.75 + 4, size * 0.3];
  context.beginPath();
  for (const [sx, sy] of [[1, 1], [1, -1], [-1, 1], [-1, -1]] as const) {
    context.moveTo(x + sx * half, y + sy * (half - arm));
    context.lineTo(x + sx * half, y + sy * half);
    context.lineTo(x + sx * (half - arm), y + sy * half);
  }
  context.stroke();
}
