/** The connection to the server of the console, and the messages that it carries. */

import { HEADER_BYTES, type FromPage, type ReportedFinding, type ToPage } from "./messages";

export type Quaternion = [number, number, number, number];

/** The fields of a message that the caller of `Connection.send` gives. */
export type Content<T extends FromPage["type"]> = Omit<Extract<FromPage, { type: T }>, "type" | "seq" | "t">;
/** The same without the grant, for messages that only the pilot may send. */
export type OrderContent<T extends FromPage["type"]> = Omit<Content<T>, "grant">;

/** Whether the echoes of a finding were evaluated, even if they gave no depth. */
export const hasEchoes = (finding: ReportedFinding): boolean => finding.verdict !== "no echoes yet";

export interface Picture {
  kind: number;
  t: number;
  where: [number, number, number, number];
  jpeg: Blob;
}

export interface Listener {
  received(message: ToPage): void;
  pictured(picture: Picture): void;
  opened(): void;
  closed(reason: string, forGood: boolean): void;
}

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
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = (event) => this.lost(event);
    this.socket = socket;
  }

  /** Send a message; the connection adds its number and time. */
  send<T extends FromPage["type"]>(type: T, content: Content<T>): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (this.socket.bufferedAmount > 16_384) return; // old inputs are useless
    this.seq += 1;
    this.socket.send(JSON.stringify({ type, seq: this.seq, t: now(), ...content }));
  }

  private receive(data: string | ArrayBuffer): void {
    if (typeof data === "string") {
      this.listener.received(JSON.parse(data) as ToPage);
      return;
    }
    const view = new DataView(data);
    const at = (k: number) => view.getFloat32(16 + 4 * k, true);
    this.listener.pictured({
      kind: view.getUint8(0),
      t: view.getFloat64(8, true),
      where: [at(0), at(1), at(2), at(3)],
      jpeg: new Blob([new Uint8Array(data, HEADER_BYTES)], { type: "image/jpeg" }),
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
