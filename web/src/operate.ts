/** The operate page: shows the messages of the server, and sends the commands of the operator. */

import { AngleChart } from "./charts";
import { Guide } from "./guide";
import { Hands } from "./hands";
import { drawPlane } from "./plane";
import type { Solid } from "./solid";
import { Stage } from "./stage";
import { MAP, type Controls, type FromPage, type Hello, type LoopState, type ReportedFinding, type SetMode } from "./messages";
import { byId, Connection, hasEchoes, now, type Content, type OrderContent, type Picture } from "./protocol";
import { WallMap } from "./wall";

const SENT_EVERY = 20; // ms
const NOTICE = 7000; // ms
const OLD = 0.5; // s: an older picture would mislead the pilot

const replay = new URLSearchParams(location.search).get("replay");
const camera = byId<HTMLCanvasElement>("camera");
const stage = new Stage(camera);
const wall = new WallMap(byId<HTMLCanvasElement>("map"));
const guide = new Guide(byId("guide"));
let charts: [AngleChart, AngleChart] | null = null;
let solid: Solid | null = null;
let hello: Hello | null = null;
let state: LoopState | null = null;
let controls: Controls | null = null;
let findings: ReportedFinding[] = [];
let recording: string | null = null;
let pictureTime: number | null = null;
let stateReceived = 0;
let drawnAt = 0;
let noticedAt = 0;
let shownReason = "";
let started: number | null = null;

function order<T extends Exclude<FromPage["type"], "take" | "ping">>(type: T, content: OrderContent<T>): void {
  if (controls?.grant) connection.send(type, { grant: controls.grant, ...content } as unknown as Content<T>);
  else if (replay === null) notice("Take the controls first.");
}

const pick = (pixel: { u: number; v: number }): void => {
  guide.asked = true;
  order("pick", pixel);
};

const commands = {
  pick(x: number, y: number) {
    if (!hello) return;
    const [u, v] = stage.pixel(x, y, hello);
    pick({ u, v });
  },
  pickMiddle() {
    if (hello) pick({ u: hello.view.width / 2, v: hello.view.height / 2 });
  },
  next() {
    const count = state?.spots.length ?? 0;
    stage.chosen = count ? (stage.chosen + 1) % count : -1;
    if (count === 0 && controls?.grant) order("find", {});
  },
  choosing: () => stage.chosen >= 0,
  confirm() {
    const spot = state?.spots[stage.chosen];
    if (spot) pick({ u: spot[0], v: spot[1] });
    stage.chosen = -1;
  },
  mode(mode: SetMode["mode"]) {
    if (controls?.grant) drive(); // so that the loop knows where the head is
    order("mode", { mode });
  },
  measure() {
    order("measure", {});
  },
  depth() {
    order("scan", {});
  },
  sweep() {
    order("sweep", {});
  },
  sharpen() {
    order("sharpen", {});
  },
  mark() {
    order("mark", {});
  },
  record() {
    order("record", { on: recording === null });
  },
  take() {
    if (controls?.grant) order("release", {});
    else connection.send("take", {});
  },
};
const hands = new Hands(commands, camera);
hands.dragged = () => {
  if (replay !== null || state?.mode === "HEAD") return;
  if (!controls?.grant) notice("Take the controls (T) to look round.");
  else if (state?.mode === "HOLD") notice("The head holds: press Head (1), then drag to look round.");
  else notice(`In ${state?.mode} the view does not follow you; press Head (1) to look round.`);
};

const connection = new Connection(
  {
    opened() {
      veil(replay === null ? (hello ? "Connected again; waiting for a picture…" : "Starting; without the file of a head its wires are identified first…") : "Opening the recording…", true);
    },
    closed(reason, forGood) {
      controls = null;
      showControls();
      veil(reason, !forGood);
    },
    received(message) {
      switch (message.type) {
        case "hello":
          hello = message;
          charts ??= [new AngleChart(byId("chart-pan"), hello.cone), new AngleChart(byId("chart-tilt"), hello.cone)];
          byId<HTMLButtonElement>("take").disabled = replay !== null;
          showControls();
          if (!hello.known.tool) byId("mark").title = "This head has no micro-tool";
          if ((guide.noProbe = hello.no_probe)) byId("depth").title = byId("sweep").title = hello.no_probe;
          break;
        case "state":
          state = message;
          stateReceived = now();
          showState(message);
          break;
        case "controls":
          controls = message;
          showControls();
          break;
        case "findings":
          findings = message.findings;
          showFindings();
          break;
        case "recording":
          showRecording(message.name, message.seconds ?? 0, message.size ?? 0);
          break;
        case "notice":
          notice(message.text);
          break;
        case "failed":
          veil(message.text, message.again ?? false);
          break;
        case "pong":
          byId("latency").textContent = `${(1000 * (now() - message.t)).toFixed(0)} ms`;
          break;
        case "depth":
          guide.fitting = message.stage;
          break;
        case "found":
          if (controls?.grant && !holdReason() && message.verdict !== "good" && message.verdict !== "no wall in view") notice(`The picture cannot be searched: it is ${message.verdict}.`);
          break;
        case "focused":
          if (message.verdict === "sharp") setFocus(1000 * message.distance);
          break;
        case "scanned":
          break;
        case "swept":
          byId("swept").hidden = false;
          byId("swept").querySelector("img")!.src = `/api/sweep.png?${message.number}`;
          text("swept-finds", `${message.finds === 1 ? "1 find" : `${message.finds} finds`}; ${message.whole ? "" : "cut off, "}${Math.round(100 * message.mapped)} % of the area mapped`);
          break;
        case "ended":
          notice("The recording has ended.");
      }
    },
    pictured: (picture) => void showPicture(picture),
  },
  replay,
);

async function showPicture(picture: Picture): Promise<void> {
  if (picture.kind === MAP) {
    await wall.show(picture);
    return;
  }
  if (await stage.show(picture, state, hello)) {
    byId("veil").hidden = true;
    pictureTime = picture.t;
    document.body.dataset.pictures = String(Number(document.body.dataset.pictures ?? 0) + 1);
  }
}

function showState(s: LoopState): void {
  started ??= s.t;
  charts?.[0].add(s.t - started, s.command[0], s.angle[0]);
  charts?.[1].add(s.t - started, s.command[1], s.angle[1]);
  guide.update(s, findings);
  document.body.dataset.mode = s.mode;
  document.body.dataset.command = s.command.join(" ");
  if (performance.now() - drawnAt < 90) return;
  drawnAt = performance.now();
  const pill = byId("mode");
  pill.textContent = replay === null ? (s.clutch && s.mode === "HEAD" ? "CLUTCH" : s.mode) : `REPLAY · ${s.mode}`;
  pill.className = `pill ${replay === null ? s.mode.toLowerCase() : "replay"}`;
  pill.title = s.reason;
  if (replay === null && !byId("veil").hidden) veil(s.trouble || "Waiting for a picture of the camera…", true);
  for (const button of document.querySelectorAll<HTMLButtonElement>("[data-mode]")) {
    if (button.tagName === "BUTTON") press(button, button.dataset.mode === s.mode);
  }
  press(byId("clutch"), s.clutch);
  text("advance", `${plain(s.place[0], 1)} mm`);
  text("roll", `${plain(s.place[1], 0)}°`);
  text("pan", angle(s.angle[0]));
  text("tilt", angle(s.angle[1]));
  byId<HTMLButtonElement>("depth").disabled = !controls?.grant || !!hello?.no_probe || findings.length === 0 || s.mode === "SCAN";
  byId<HTMLButtonElement>("sweep").disabled = !controls?.grant || !!hello?.no_probe || s.mode === "SCAN";
  if (s.received && controls?.grant) text("latency", `${Math.max(0, 1000 * (now() - s.received.t)).toFixed(0)} ms`);
  if (s.trouble) notice(s.trouble);
  else if (holdReason() && controls?.grant) {
    if (shownReason !== s.reason || performance.now() - noticedAt > NOTICE || byId("notice").hidden) notice((shownReason = s.reason));
  }
  else if (byId("notice").textContent === shownReason) byId("notice").hidden = true;
  else if (performance.now() - noticedAt > NOTICE) byId("notice").hidden = true;
  if (!hello) return;
  for (const k of [0, 1] as const) {
    text(`hot-${k}`, `≤ ${s.temperature[k].toFixed(0)} °C`);
    const labels = { alpha: "on at [A²]", beta: "off at [A²]", margin: 16 };
    drawPlane(byId<HTMLCanvasElement>(`plane-${k}`), hello.planes[k]!, s.memory[k], labels);
  }
  wall.draw(hello, s);
}

function showControls(): void {
  const take = byId("take");
  const mine = Boolean(controls?.grant);
  const long = document.createElement("span");
  long.className = "long";
  long.textContent = " the controls";
  if (controls?.pilot && !mine) take.replaceChildren(`Viewer ${controls.pilot} steers`);
  else take.replaceChildren(mine ? "Release" : "Take", long);
  take.classList.toggle("leaving", mine);
  text("viewers", controls ? `${controls.viewers} ${controls.viewers === 1 ? "page" : "pages"}` : "");
  document.body.dataset.pilot = mine ? "yes" : "no";
  for (const id of ["clutch", "measure", "record", "sharpen"]) byId<HTMLButtonElement>(id).disabled = !mine;
  byId<HTMLButtonElement>("mark").disabled = !mine || !hello?.known.tool;
  for (const button of document.querySelectorAll<HTMLButtonElement>("button[data-mode]")) button.disabled = !mine;
}

function showFindings(): void {
  wall.findings = findings;
  byId("findings").replaceChildren(
    ...findings.map((f) => {
      const item = document.createElement("li");
      const line = document.createElement("span");
      line.append(...description(f));
      const forget = document.createElement("button");
      forget.className = "plain";
      forget.textContent = "×";
      forget.setAttribute("aria-label", `Delete finding ${f.number}`);
      forget.onclick = () => order("forget", { finding: f.number });
      item.append(line, ...meshes(f), forget);
      return item;
    }),
  );
  if (findings.length === 0 && !solid) return;
  void showSolid();
}

/** Kind, diameter, depth and place of a finding, with their uncertainties. */
function description(f: ReportedFinding): (string | HTMLElement)[] {
  const name = document.createElement("b");
  name.textContent = `${f.number} · ${hasEchoes(f) ? f.kind : "hole or pit"}`;
  const rest = document.createElement("small");
  rest.textContent = `at ${f.z.toFixed(2)} ± ${f.z_sd.toFixed(2)} mm, ${f.phi.toFixed(1)} ± ${f.phi_sd.toFixed(1)}°`;
  const depth = f.depth === null ? (hasEchoes(f) ? `depth unknown: ${f.verdict}` : "depth not measured yet") : `${f.depth.toFixed(3)} ± ${(f.depth_sd ?? 0).toFixed(3)} mm deep`;
  return [name, ` ⌀ ${f.diameter.toFixed(2)} ± ${f.diameter_sd.toFixed(2)} mm · ${depth}`, rest];
}

function meshes(f: ReportedFinding): HTMLElement[] {
  if (!f.patch) return [];
  return ["ply", "glb"].map((kind) => {
    const link = document.createElement("a");
    link.href = `/api/findings/${f.number}.${kind}`;
    link.download = "";
    link.textContent = kind.toUpperCase();
    link.title = "The wall around it, in three dimensions";
    return link;
  });
}

async function showSolid(): Promise<void> {
  if (!solid && hello) {
    const { Solid } = await import("./solid");
    try {
      solid ??= new Solid(byId("solid"), 1000 * hello.view.radius);
    } catch {
      text("solid", "This browser cannot show three dimensions; the list below has the numbers.");
    }
  }
  solid?.show(findings, wall.bitmap, wall.range);
}

/** Show the age of the picture, by the clock of the loop, when it is old. */
function showAge(): void {
  const age = state && pictureTime !== null ? state.t - pictureTime + now() - stateReceived : 0;
  const box = byId("age");
  box.hidden = age < OLD || !byId("veil").hidden;
  text("age", `picture is ${age < 10 ? age.toFixed(1) : age.toFixed(0)} s old`);
}

function showRecording(name: string | null, seconds: number, size: number): void {
  const [minutes, rest] = [Math.floor(seconds / 60), Math.floor(seconds % 60)];
  text("recorded", name === null ? "Record" : `${minutes}:${String(rest).padStart(2, "0")} · ${(size / 1e6).toFixed(0)} MB`);
  if (recording !== null && name === null) notice(`Recorded as ${recording}; find it under “?”.`);
  recording = name;
  press(byId("record"), name !== null);
}

/** Return why the head holds; no hint of the search takes its place. */
function holdReason(): string {
  return state?.mode === "HOLD" ? state.reason : "";
}

function notice(sentence: string): void {
  const box = byId("notice");
  if (box.textContent !== sentence) box.textContent = sentence;
  box.hidden = false;
  noticedAt = performance.now();
}

function veil(sentence: string, working: boolean): void {
  byId("veil").hidden = false;
  text("veil-text", sentence);
  document.querySelector<HTMLElement>(".spinner")!.hidden = !working;
}

function text(id: string, content: string): void {
  const element = byId(id);
  if (element.textContent !== content) element.textContent = content;
}

const press = (element: HTMLElement, on: boolean): void => element.setAttribute("aria-pressed", String(on));
/** A number; never "-0". */
const plain = (value: number, digits: number): string => value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
const angle = (value: number | null): string => (value === null ? "lost" : `${plain(value, 1)}°`);

function setFocus(mm: number): void {
  byId<HTMLInputElement>("focus").value = mm.toFixed(0);
  text("focus-shown", `${mm.toFixed(1)} mm`);
}

async function changeSource(): Promise<void> {
  const select = byId<HTMLSelectElement>("source");
  const source = select.value as Hands["source"];
  let trouble = "";
  if (source === "phone") trouble = await hands.usePhone();
  if (source === "headset") {
    const { startHeadset } = await import("./headset");
    try {
      trouble = await startHeadset(camera, {
        pose: (pose, stick, clutch) => hands.headsetMoved(pose, stick, clutch),
        select: () => commands.pickMiddle(),
        ended() {
          hands.headsetEnded();
          select.value = hands.source = "mouse";
          order("mode", { mode: "HOLD" });
        },
      });
    } catch (error) {
      trouble = `The headset cannot be used: ${String(error)}`;
    }
  }
  if (trouble) {
    notice(trouble);
    select.value = hands.source;
    return;
  }
  if (controls?.grant && source !== hands.source) order("mode", { mode: "HOLD" });
  hands.source = source;
}

async function showMenu(): Promise<void> {
  byId<HTMLDialogElement>("help").showModal();
  const names = (await (await fetch("/api/recordings")).json()) as string[];
  if (names.length === 0) return;
  byId("recordings").replaceChildren(
    ...names.map((name) => {
      const item = document.createElement("li");
      const link = document.createElement("a");
      link.href = `/?replay=${encodeURIComponent(name)}`;
      link.textContent = name;
      item.append(link);
      return item;
    }),
  );
}

byId("take").onclick = commands.take;
byId("measure").onclick = commands.measure;
byId("depth").onclick = commands.depth;
byId("sweep").onclick = commands.sweep;
byId("sharpen").onclick = commands.sharpen;
byId("mark").onclick = commands.mark;
byId("record").onclick = commands.record;
byId("menu").onclick = () => void showMenu();
byId("source").onchange = () => void changeSource();
byId<HTMLInputElement>("focus").oninput = (event) => {
  const mm = Number((event.target as HTMLInputElement).value);
  text("focus-shown", `${mm} mm`);
  order("focus", { distance: mm / 1000 });
};
for (const button of document.querySelectorAll<HTMLButtonElement>("button[data-mode]")) {
  button.onclick = () => commands.mode(button.dataset.mode as SetMode["mode"]);
}

function drive(): void {
  const { pose, age } = hands.look();
  order("drive", { pose, age, stick: hands.stick(), clutch: hands.clutch() });
}

window.setInterval(() => {
  hands.tick();
  if (controls?.grant) drive();
}, SENT_EVERY);
window.setInterval(showAge, 250);
window.setInterval(() => {
  if (replay === null && !controls?.grant) connection.send("ping", {});
}, 1000);

showControls();
connection.open();
