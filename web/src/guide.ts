/** The six steps of an inspection; each is ticked off by what happens, not by the reader. */

import type { Finding, State } from "./talk";

const STEPS = [
  ["Look", "Take the controls and press Head. Look round with the mouse, a phone or a headset; push the catheter in with W."],
  ["Pick", "Click what you want to inspect, or press N to go through the candidates and Enter to pick one."],
  ["Focus", "Press Track: the camera now keeps the point centred whatever your head does. Then set the focus."],
  ["Extract", "Wait until the point stands still in the middle, and press Measure: its outline gives place and size."],
  ["Depth", "This head carries no ultrasonic sensor, so the depth stays open."],
  ["Finding", "The finding is in the list, on the map and in three dimensions. Download it, or go on to the next."],
] as const;

export class Guide {
  private now = 0;
  private moved = 0;
  private skipped = false;
  private focused = false;
  private readonly items: HTMLLIElement[];
  private readonly hint: HTMLLIElement;
  private readonly skip: HTMLButtonElement;
  private readonly text: HTMLSpanElement;

  constructor(list: HTMLElement) {
    this.items = STEPS.map(([name], k) => {
      const item = document.createElement("li");
      item.innerHTML = `${k + 1}<b>${name}</b>`;
      return item;
    });
    this.hint = document.createElement("li");
    this.hint.className = "hint";
    this.hint.setAttribute("role", "status");
    this.text = document.createElement("span");
    this.skip = document.createElement("button");
    this.skip.textContent = "Go on without depth";
    this.skip.onclick = () => (this.skipped = true);
    this.hint.append(this.text, this.skip);
    list.append(...this.items, this.hint);
    this.draw();
  }

  focusSet(): void {
    this.focused = true;
  }

  /** Start over, for the next defect. */
  again(): void {
    this.skipped = this.focused = false;
  }

  update(state: State, findings: Finding[]): void {
    if (state.mode === "HEAD") this.moved = Math.max(this.moved, Math.hypot(...state.command));
    const done = [
      this.moved > 3 || state.target !== null,
      state.target !== null,
      state.mode === "TRACK" && (this.focused || findings.length > 0),
      findings.length > 0,
      findings.length > 0 && (this.skipped || findings.some((finding) => finding.depth !== null)),
      false,
    ];
    const first = done.indexOf(false);
    if (first !== this.now) {
      this.now = first;
      this.draw();
    }
  }

  private draw(): void {
    this.items.forEach((item, k) => {
      item.className = k < this.now ? "done" : k === this.now ? "now" : "";
      if (k === this.now) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    });
    this.text.textContent = STEPS[this.now]![1];
    this.skip.hidden = this.now !== 4;
  }
}
