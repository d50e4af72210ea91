/** The unrolled wall of the pipe: z from left to right, phi from top to bottom. */

import { fitted } from "./plane";
import type { Hello, LoopState, ReportedFinding } from "./messages";
import type { Picture } from "./protocol";

export class WallMap {
  /** The newest map; the three-dimensional view shows it too. */
  bitmap: ImageBitmap | null = null;
  /** The z of its first and last row in mm. */
  range: [number, number] = [0, 100];
  findings: ReportedFinding[] = [];

  constructor(private readonly canvas: HTMLCanvasElement) {}

  async show(picture: Picture): Promise<void> {
    this.range = [picture.where[0], picture.where[1]];
    const bitmap = await createImageBitmap(picture.jpeg);
    this.bitmap?.close();
    this.bitmap = bitmap;
  }

  /** Draw the map, unless nobody can see it. */
  draw(hello: Hello, state: LoopState): void {
    if (this.canvas.clientWidth === 0) return;
    const context = fitted(this.canvas);
    const { width, height } = this.canvas;
    const ratio = width / this.canvas.clientWidth || 1;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = "#06080a";
    context.fillRect(0, 0, width, height);
    if (this.bitmap) {
      // Rows of the picture go along the pipe: x and y change places.
      context.setTransform(0, height / this.bitmap.width, width / this.bitmap.height, 0, 0, 0);
      context.drawImage(this.bitmap, 0, 0);
      context.setTransform(1, 0, 0, 1, 0, 0);
    }
    const [first, last] = this.range;
    const x = (z: number) => ((z - first) / (last - first)) * width;
    const y = (phi: number) => ((((phi % 360) + 360) % 360) / 360) * height;
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    context.lineWidth = 1.5 * ratio;
    for (const finding of this.findings) {
      context.strokeStyle = context.fillStyle = "#46d6b8";
      context.beginPath();
      context.arc(x(finding.z), y(finding.phi), 7 * ratio, 0, 2 * Math.PI);
      context.stroke();
      context.fillText(String(finding.number), x(finding.z) + 9 * ratio, y(finding.phi) + 4 * ratio);
    }
    const aim = middle(hello, state);
    if (aim) {
      context.strokeStyle = "#ffb454";
      context.strokeRect(x(aim[1]) - 6 * ratio, y(aim[0]) - 6 * ratio, 12 * ratio, 12 * ratio);
    }
    context.fillStyle = "#93a3ad";
    context.textAlign = "left";
    context.fillText(`${first.toFixed(0)} mm`, 4 * ratio, height - 5 * ratio);
    context.textAlign = "right";
    context.fillText(`${last.toFixed(0)} mm`, width - 4 * ratio, height - 5 * ratio);
    context.textAlign = "left";
    context.fillText("0°", 4 * ratio, 12 * ratio);
  }
}

/** Phi in degrees and z in mm where the line of sight meets the wall. */
export function middle(hello: Hello, state: LoopState): [number, number] | null {
  if (state.angle[0] === null || state.angle[1] === null) return null;
  const [pan, tilt] = [(state.angle[0] * Math.PI) / 180, (state.angle[1] * Math.PI) / 180];
  const ray = [Math.sin(pan) * Math.cos(tilt), -Math.sin(tilt), Math.cos(pan) * Math.cos(tilt)] as const;
  const off = Math.hypot(ray[0], ray[1]);
  if (off < 0.05) return null;
  const far = hello.view.radius / off; // from the pivot
  const phi = (Math.atan2(ray[1], ray[0]) * 180) / Math.PI + state.place[1];
  return [phi, 1000 * far * ray[2] + state.place[0]];
}
