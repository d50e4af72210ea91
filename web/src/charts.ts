/** Chart of command and angle of an axis over the last seconds. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";

const KEPT = 20; // s

export class AngleChart {
  private readonly t: number[] = [];
  private readonly command: number[] = [];
  private readonly angle: (number | null)[] = [];
  private readonly plot: uPlot;
  private drawn = 0;

  constructor(
    private readonly box: HTMLElement,
    cone: number,
  ) {
    const axis = { stroke: "#93a3ad", grid: { stroke: "#222b32", width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    this.plot = new uPlot(
      {
        width: box.clientWidth || 300,
        height: box.clientHeight || 96,
        padding: [6, 14, 0, 0],
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false }, y: { range: (_, low, high) => limits(low, high, cone) } },
        axes: [
          { ...axis, size: 20, values: (_, ticks) => ticks.map((tick) => `${tick} s`) },
          { ...axis, size: 34, space: 20, values: (_, ticks) => ticks.map((tick) => `${tick}°`) },
        ],
        series: [{}, { stroke: "#ffb454", width: 1.5 }, { stroke: "#46d6b8", width: 2 }],
      },
      [[], [], []],
      box,
    );
    box.querySelector("canvas")!.setAttribute("aria-hidden", "true"); // the box has the label
    new ResizeObserver(() => this.plot.setSize({ width: box.clientWidth, height: box.clientHeight })).observe(box);
  }

  add(t: number, command: number, angle: number | null): void {
    if (this.t.length > 0 && t < this.t[this.t.length - 1]!) this.clear();
    this.t.push(t);
    this.command.push(command);
    this.angle.push(angle);
    while (this.t.length > 0 && this.t[0]! < t - KEPT) {
      this.t.shift();
      this.command.shift();
      this.angle.shift();
    }
    if (performance.now() - this.drawn > 100 && this.box.clientWidth > 0) {
      this.drawn = performance.now();
      this.plot.setData([this.t.map((each) => each - t), this.command, this.angle]);
    }
  }

  private clear(): void {
    this.t.length = this.command.length = this.angle.length = 0;
  }
}

function limits(low: number | null, high: number | null, cone: number): [number, number] {
  if (low === null || high === null) return [-cone, cone];
  const middle = (low + high) / 2;
  const half = Math.max((high - low) / 2, 2) * 1.15;
  return [middle - half, middle + half];
}
