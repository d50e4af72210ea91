/** The Preisach plane: how much weight each cell has, and the line between relays on and off. */

export interface Plane {
  levels: number[];
  weights: (number | null)[][];
}

/** Corners (beta, alpha) of the line that an extremal memory draws, from the left to the diagonal. */
export function staircase(memory: number[], low: number): [number, number][] {
  const line: [number, number][] = [];
  let beta = low;
  for (let k = 1; k < memory.length; k += 1) {
    const value = memory[k]!;
    if (k % 2 === 1) {
      line.push([beta, value]);
      if (k === memory.length - 1) line.push([value, value]);
    } else {
      line.push([value, memory[k - 1]!]);
      beta = value;
      if (k === memory.length - 1) line.push([value, value]);
    }
  }
  if (line.length === 0) line.push([low, memory[0] ?? low]);
  return line;
}

export interface Labels {
  alpha: string;
  beta: string;
  margin: number;
  /** Whether the axes have ticks with numbers, and the colours a bar. */
  numbers?: boolean;
}

const QUIET = "#93a3ad";

/** Draw a plane and its memory into a canvas, at the resolution of the screen; not if it is hidden. */
export function drawPlane(canvas: HTMLCanvasElement, plane: Plane, memory: number[] | null, labels: Labels): void {
  if (canvas.clientWidth === 0) return;
  const context = fitted(canvas);
  const { width, height } = canvas;
  const ratio = width / canvas.clientWidth || 1;
  const margin = labels.margin * ratio;
  const low = plane.levels[0]!;
  const high = plane.levels[plane.levels.length - 1]!;
  const right = (labels.numbers ? 86 : 6) * ratio;
  const x = (beta: number) => margin + ((beta - low) / (high - low)) * (width - margin - right);
  const y = (alpha: number) => height - margin - ((alpha - low) / (high - low)) * (height - margin - 6 * ratio);
  context.clearRect(0, 0, width, height);
  const most = drawCells(context, plane, x, y);
  context.strokeStyle = "#2a343c";
  context.lineWidth = ratio;
  context.beginPath();
  context.moveTo(x(low), y(high));
  context.lineTo(x(low), y(low));
  context.lineTo(x(high), y(high));
  context.closePath();
  context.stroke();
  if (memory) drawMemory(context, staircase(memory, low), low, x, y, ratio);
  context.fillStyle = QUIET;
  context.font = `${11 * ratio}px system-ui, sans-serif`;
  if (labels.numbers) {
    drawTicks(context, low, high, x, y, ratio);
    drawBar(context, most, plane.weights.flat().some((weight) => (weight ?? 0) < 0), width - 62 * ratio, y(high), y(low), ratio);
  }
  context.textAlign = "right";
  context.fillText(labels.beta, x(high), height - 4 * ratio);
  context.save();
  context.translate((labels.numbers ? 12 : labels.margin - 5) * ratio, 8 * ratio);
  context.rotate(-Math.PI / 2);
  context.fillText(labels.alpha, 0, 0);
  context.restore();
}

/** Round numbers between two ends, about five of them. */
function ticks(low: number, high: number): number[] {
  const rough = (high - low) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
  const found: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return found;
}

/** Return a number for a tick: up to six digits, small and large ones with an exponent. */
export const shortNumber = (value: number): string => String(Number(value.toPrecision(6)));

function drawTicks(
  context: CanvasRenderingContext2D,
  low: number,
  high: number,
  x: (beta: number) => number,
  y: (alpha: number) => number,
  ratio: number,
): void {
  context.strokeStyle = QUIET;
  for (const value of ticks(low, high)) {
    context.beginPath();
    context.moveTo(x(value), y(low));
    context.lineTo(x(value), y(low) + 4 * ratio);
    context.moveTo(x(low), y(value));
    context.lineTo(x(low) - 4 * ratio, y(value));
    context.stroke();
    context.textAlign = "center";
    context.fillText(shortNumber(value), x(value), y(low) + 16 * ratio);
    context.textAlign = "right";
    context.fillText(shortNumber(value), x(low) - 6 * ratio, y(value) + 4 * ratio);
  }
}

/** Draw the colours with their densities. */
function drawBar(
  context: CanvasRenderingContext2D,
  most: number,
  signed: boolean,
  left: number,
  top: number,
  bottom: number,
  ratio: number,
): void {
  const low = signed ? -1 : 0;
  const place = (share: number) => bottom + ((share - low) / (1 - low)) * (top - bottom);
  const steps = 128;
  for (let k = 0; k < steps; k += 1) {
    const share = low + ((k + 0.5) / steps) * (1 - low);
    const upper = place(low + ((k + 1) / steps) * (1 - low));
    context.fillStyle = colour(share);
    context.fillRect(left, upper, 10 * ratio, (bottom - top) / steps + 1);
  }
  context.fillStyle = QUIET;
  context.textAlign = "left";
  for (const value of ticks(low * most, most)) {
    context.fillText(shortNumber(value), left + 14 * ratio, place(most > 0 ? value / most : 0) + 4 * ratio);
  }
  context.textAlign = "center";
  context.fillText("density", left + 16 * ratio, bottom + 16 * ratio);
}

/** Draw the cells; return the greatest density. */
function drawCells(
  context: CanvasRenderingContext2D,
  plane: Plane,
  x: (beta: number) => number,
  y: (alpha: number) => number,
): number {
  const density: number[][] = [];
  let most = 0;
  plane.weights.forEach((row, i) => {
    density.push([]);
    row.forEach((weight, j) => {
      const tall = plane.levels[i + 1]! - plane.levels[i]!;
      const wide = plane.levels[j + 1]! - plane.levels[j]!;
      const value = (weight ?? 0) / (tall * wide * (i === j ? 0.5 : 1));
      density[i]!.push(value);
      most = Math.max(most, Math.abs(value));
    });
  });
  density.forEach((row, i) =>
    row.forEach((value, j) => {
      context.fillStyle = colour(most > 0 ? value / most : 0);
      const [left, right] = [x(plane.levels[j]!), x(plane.levels[j + 1]!)];
      const [top, bottom] = [y(plane.levels[i + 1]!), y(plane.levels[i]!)];
      context.beginPath();
      context.moveTo(left, top);
      context.lineTo(right + 0.5, top);
      if (i !== j) context.lineTo(right + 0.5, bottom + 0.5);
      context.lineTo(left, bottom + 0.5);
      context.fill();
    }),
  );
  return most;
}

/** From nothing over green to yellow; red where weights are negative. */
function colour(share: number): string {
  const s = Math.sqrt(Math.abs(share));
  if (share < 0) return `rgb(${30 + 200 * s} ${34 + 20 * s} ${50 + 20 * s})`;
  return `rgb(${20 + 210 * s * s} ${27 + 178 * s} ${36 + 110 * s - 90 * s * s})`;
}

function drawMemory(
  context: CanvasRenderingContext2D,
  line: [number, number][],
  low: number,
  x: (beta: number) => number,
  y: (alpha: number) => number,
  ratio: number,
): void {
  context.beginPath();
  line.forEach(([beta, alpha], k) => (k === 0 ? context.moveTo(x(beta), y(alpha)) : context.lineTo(x(beta), y(alpha))));
  const path = new Path2D();
  path.moveTo(x(low), y(low));
  line.forEach(([beta, alpha]) => path.lineTo(x(beta), y(alpha)));
  path.closePath();
  context.fillStyle = "rgb(108 182 255 / 0.16)";
  context.fill(path);
  context.strokeStyle = "#ffffff";
  context.lineWidth = 2 * ratio;
  context.lineJoin = "round";
  context.stroke();
  const [beta, alpha] = line[line.length - 1]!;
  context.fillStyle = "#ffb454";
  context.beginPath();
  context.arc(x(beta), y(alpha), 4 * ratio, 0, 2 * Math.PI);
  context.fill();
}

/** The context of a canvas that has as many pixels as the screen shows of it. */
export function fitted(canvas: HTMLCanvasElement): CanvasRenderingContext2D {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser draws no canvas");
  return context;
}
