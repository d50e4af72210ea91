/** The six steps of an inspection; each is marked done when its result is there. */

import type { ReportedFinding, LoopState } from "./messages";
import { hasEchoes } from "./protocol";

const STEPS = [
  ["Look", "Take the controls (T), press Head (1) and look round: drag the image, or use the arrow keys. W pushes the catheter in. Turn well to the side: where the wall is near and the head rests, possible defects are framed."],
  ["Pick", "Click what you want to inspect, or press N to go through the frames and Enter to pick one."],
  ["Focus", "Press Track (2): the camera centres the point, keeps it there however you move, and focuses on it."],
  ["Extract", "Press Measure (M): three lights flash one by one, and the outline that all of them show gives place and size."],
  ["Depth", "Press Depth (E): the pipe is flooded, and the head brings its ultrasonic probe over the finding, point by point. Hold stops it."],
  ["Finding", "It is in the list, on the map and in three dimensions. Download it, or press Head and continue with the next."],
] as const;

/** The same for operators without a keyboard. */
const TOUCH: Record<number, string> = {
  0: "Take the controls, press Head and look round: drag the image, or look with this phone. The round pad pushes the catheter in and rolls it. Turn well to the side: where the wall is near and the head rests, possible defects are framed.",
  1: "Tap what you want to inspect.",
};
const touched = window.matchMedia("(pointer: coarse)").matches;
const hint = (step: number): string => (touched ? (TOUCH[step] ?? STEPS[step]![1].replace(/ \([A-Z1-3]\)/g, "")) : STEPS[step]![1]);

export class Guide {
  private now = -1;
  private moved = 0;
  private count = 0;
  private picked = false;
  private readonly items: HTMLLIElement[];
  private readonly text: HTMLSpanElement;
  private readonly bar: HTMLProgressElement;

  constructor(list: HTMLElement) {
    this.items = STEPS.map(([name], k) => {
      const item = document.createElement("li");
      item.innerHTML = `<i>${k + 1}</i><b>${name}</b>`;
      return item;
    });
    const line = document.createElement("li");
    line.className = "hint";
    line.setAttribute("role", "status");
    this.text = document.createElement("span");
    this.bar = document.createElement("progress");
    this.bar.hidden = true;
    line.append(this.text, this.bar);
    list.append(...this.items, line);
    this.draw(0, hint(0));
  }

  /** Whether this page has picked a point. */
  asked = false;

  /** Why no depth can be measured; empty with a probe. */
  noProbe = "";

  /** Stage of the fit of the echoes; empty when there is none. */
  fitting = "";

  update(state: LoopState, findings: ReportedFinding[]): void {
    if (state.mode === "HEAD") this.moved = Math.max(this.moved, Math.hypot(...state.command));
    // Looking round after a finding starts the next inspection.
    if (state.mode === "HEAD" && findings.length > 0) this.count = findings.length;
    const fresh = findings.slice(this.count);
    // A target that was lost before this page connected does not count as picked.
    if (state.target === null) this.picked = false;
    else if (state.target[3] > 0 || this.asked) this.picked = true;
    const done = [
      this.moved > 3 || this.picked || fresh.length > 0,
      this.picked || fresh.length > 0,
      (state.mode === "TRACK" && state.focus !== "" && state.focus !== "searching") || fresh.length > 0,
      fresh.length > 0,
      fresh.length > 0 && hasEchoes(fresh[fresh.length - 1]!),
      false,
    ];
    const step = done.indexOf(false);
    this.draw(step, this.sentence(step, state));
    const share = state.mode === "SCAN" ? (state.scan?.progress ?? 0) : null;
    this.bar.hidden = share === null && !this.fitting;
    if (share !== null) this.bar.value = share;
    else this.bar.removeAttribute("value");
  }

  private sentence(step: number, state: LoopState): string {
    if (state.mode === "SCAN" && state.scan?.finding === 0) return SWEEPING[state.scan.stage] ?? "Sweeping the wall, line by line.";
    if (step === 4 && this.noProbe) return `There is no depth: ${this.noProbe}. The finding is in the list.`;
    if (step === 2 && state.mode === "TRACK") return state.centred ? "In the middle: focusing on it." : "Turning until the point is in the middle.";
    if (step === 4 && state.mode === "SCAN") return SCANNING[state.scan?.stage ?? ""] ?? "";
    if (step === 4 && this.fitting) return `Scanned; ${this.fitting}. You can continue meanwhile.`;
    return hint(step);
  }

  private draw(step: number, sentence: string): void {
    if (this.text.textContent !== sentence) this.text.textContent = sentence;
    if (step === this.now) return;
    this.now = step;
    this.items.forEach((item, k) => {
      item.className = k < step ? "done" : k === step ? "now" : "";
      if (k === step) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    });
  }
}

const SWEEPING: Record<string, string> = {
  travel: "The catheter brings the probe to the first line of the sweep.",
  back: "Going back to where you looked from.",
};

const SCANNING: Record<string, string> = {
  travel: "The catheter brings the probe to the finding.",
  turn: "Turning the beam to the first point.",
  points: "Measuring, point by point.",
  roll: "The catheter rolls to the next row of points.",
  back: "Going back to where you looked from.",
};
