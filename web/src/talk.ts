/** What is said between this page and the server, and the connection it is said over. */

export type Mode = "HEAD" | "TRACK" | "SCAN" | "HOLD";
export type Quaternion = [number, number, number, number];

export interface Hello {
  type: "hello";
  interval: number;
  view: { width: number; height: number; focal: number; centre: [number, number]; lever: number; radius: number };
  cone: number;
  middle: number;
  stick: [number, number];
  planes: { levels: number[]; weights: number[][] }[];
}

export interface State {
  type: "state";
  seq: number;
  t: number;
  mode: Mode;
  reason: string;
  /** When the plant was last made safe, on the clock of the loop; 0 if never. */
  safe_at: number;
  command: [number, number];
  angle: [number | null, number | null];
  place: [number, number];
  rates: [number, number];
  current: [number, number];
  temperature: [number, number];
  memory: [number[], number[]];
  trouble: string;
  clutch: boolean;
  heard: { seq: number; t: number } | null;
  late: number;
  target: [number, number, number, number] | null;
  spots: [number, number, number, number][];
  centred: boolean;
  focus: string;
  scan: { finding: number; stage: string; progress: number } | null;
}

export interface Finding {
  number: number;
  phi: number;
  z: number;
  diameter: number;
  depth: number | null;
  depth_sd: number | null;
  diameter_sd: number;
  phi_sd: number;
  z_sd: number;
  kind: string;
  verdict: string;
  evidence: number;
  /** Depths about it in mm, rows along the pipe and columns round it, from phi in degrees and z in mm. */
  patch: { phi: number; z: number; step: number; depth: (number | null)[][]; through?: [number, number][] } | null;
}

/** Whether echoes have told of a finding, if only that they cannot tell its depth. */
export const heard = (finding: Finding): boolean => finding.verdict !== "not heard";

export interface Seats {
  type: "seats";
  you: number;
  pilot: number | null;
  viewers: number;
  grant: number;
}

type Said =
  | Hello
  | State
  | Seats
  | { type: "findings"; findings: Finding[] }
  | { type: "recording"; name: string | null; seconds?: number; size?: number }
  | { type: "notice"; text: string }
  /** `again`: what failed is being started anew. */
  | { type: "failed"; text: string; again?: boolean }
  | { type: "pong"; t: number }
  | { type: "found"; count: number; verdict: string }
  | { type: "focused"; distance: number; verdict: string }
  | { type: "scanned"; finding: number }
  | { type: "depth"; finding: number; stage: string; seconds: number }
  | { type: "ended" };

export interface Picture {
  kind: number;
  t: number;
  where: [number, number, number, number];
  jpeg: Blob;
}

export interface Listener {
  said(message: Said): void;
  shown(picture: Picture): void;
  opened(): void;
  closed(reason: string, forGood: boolean): void;
}

const HEADER = 32;

/** Seconds on this page's clock. */
export const now = (): number => performance.now() / 1000;

export class Connection {
  private socket: WebSocket | null = null;
  private seq = 0;
  private wait = 300;

  constructor(
    private readonly listener: Listener,
    private readonly replay: string | null,
  ) {}

  open(): void {
    const query = this.replay === null ? "" : `?replay=${encodeURIComponent(this.replay)}`;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws${query}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.wait = 300;
      this.seq = 0;
      this.listener.opened();
    };
    socket.onmessage = (event) => this.heard(event.data);
    socket.onclose = (event) => this.lost(event);
    this.socket = socket;
  }

  /** Send a message; the connection adds its number and time. */
  send(type: string, content: Record<string, unknown> = {}): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (this.socket.bufferedAmount > 16_384) return; // old inputs are worth nothing
    this.seq += 1;
    this.socket.send(JSON.stringify({ type, seq: this.seq, t: now(), ...content }));
  }

  private heard(data: string | ArrayBuffer): void {
    if (typeof data === "string") {
      this.listener.said(JSON.parse(data) as Said);
      return;
    }
    const view = new DataView(data);
    const at = (k: number) => view.getFloat32(16 + 4 * k, true);
    this.listener.shown({
      kind: view.getUint8(0),
      t: view.getFloat64(8, true),
      where: [at(0), at(1), at(2), at(3)],
      jpeg: new Blob([new Uint8Array(data, HEADER)], { type: "image/jpeg" }),
    });
  }

  private lost(event: CloseEvent): void {
    const forGood = event.code === 1008 || this.replay !== null;
    const reason = event.reason || "The connection to the console was lost.";
    this.listener.closed(reason, forGood);
    if (forGood) return;
    window.setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, 4000);
  }
}

/** The element with an id. */
export function byId<T extends HTMLElement = HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`there is no element ${id}`);
  return found as T;
}
