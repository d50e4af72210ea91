/** The lab page: a model from a CSV file. The server computes everything with the library. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { drawPlane, shortNumber } from "./plane";
import { byId } from "./protocol";

interface Column {
  header: string;
  trouble?: string;
  unit: string;
  rows: number;
  measured: number;
  course: (number | null)[];
  time: boolean;
}

interface Result {
  input: string;
  output: string;
  u: (number | null)[];
  y: (number | null)[];
  fit: (number | null)[];
  rows: number[];
  clock: string;
  held: number | null;
  loop: { u: (number | null)[]; y: (number | null)[]; fit: (number | null)[]; joined: boolean };
  levels: number[];
  weights: (number | null)[][];
  range: [number, number];
  scores: { lag: number; unknowns: number; seconds: number };
  table: [string, string][];
  choices: string[];
  advice: string[];
}

interface Answer {
  stage?: string;
  error?: string;
  result?: Result;
  report?: boolean;
}

let user = "";
let columns: Column[] = [];
/** Headers of all columns, also of those that are no numbers. */
let headers: string[] = [];
let result: Result | null = null;
let memory: number[] | null = null;
const plots = new Map<string, uPlot>();

const show = (id: string, on = true): void => {
  byId(id).hidden = !on;
};

function trouble(sentence: string): void {
  byId("trouble").textContent = sentence;
  show("trouble", sentence !== "");
}

/** Ask the server; show its sentence on the page if it refuses. */
async function ask(path: string, body: BodyInit): Promise<any> {
  try {
    const answer = await fetch(path, { method: "POST", body });
    const content = await answer.json();
    if (!answer.ok) trouble(content.error ?? "The server refused this.");
    return answer.ok ? content : null;
  } catch {
    trouble("The server of this page does not answer; is minorloop lab still running?");
    return null;
  }
}

async function drop(file: File): Promise<void> {
  trouble("");
  for (const id of ["setup", "preview", "result"]) show(id, false);
  byId("drop-title").textContent = `Reading ${file.name}…`;
  const reply = await ask(`/api/lab?name=${encodeURIComponent(file.name)}`, file);
  byId("drop-title").textContent = reply ? `${reply.name}` : "Drop a CSV, get a model";
  byId("drop").classList.toggle("small", reply !== null);
  if (!reply) return;
  user = reply.user;
  headers = (reply.columns as Column[]).map((column) => column.header);
  columns = (reply.columns as Column[]).filter((column) => !column.trouble);
  byId("drop-title").textContent = `${reply.name}: ${columns[0]!.rows} rows`;
  byId<HTMLFormElement>("choices").reset();
  choose(reply.time);
  show("setup");
  drawLoop();
  byId("identify").focus();
}

/** Offer the columns; the first two that are not time are suggested as input and output. */
function choose(time: string | null): void {
  const names = columns.map((column) => column.header);
  const candidates = columns.filter((column) => !column.time && column.header !== time).map((column) => column.header);
  const guess = candidates.length >= 2 ? candidates : names;
  for (const [id, chosen] of [["input", guess[0]], ["output", guess[1]]] as const) {
    const select = byId<HTMLSelectElement>(id);
    select.replaceChildren(...names.map((name) => new Option(name, name, false, name === chosen)));
  }
  for (const id of ["time", "curves", "groups"]) {
    const chosen = id === "time" && time !== guess[0] && time !== guess[1] ? time : null;
    const options = headers.map((name) => new Option(name, name, false, name === chosen));
    byId<HTMLSelectElement>(id).replaceChildren(new Option("none", ""), ...options);
  }
}

function drawLoop(): void {
  const of = (id: string) => columns.find((column) => column.header === byId<HTMLSelectElement>(id).value);
  const [input, output] = [of("input"), of("output")];
  if (!input || !output) return;
  show("preview");
  const joined = input.rows === input.course.length;
  loop("loop", input.course, [{ y: output.course, colour: MEASURED, name: "measured" }], joined, input.header, output.header);
}

async function identify(): Promise<void> {
  trouble("");
  const value = (id: string) => byId<HTMLInputElement | HTMLSelectElement>(id).value;
  const lag = value("lag");
  const slope = value("slope");
  const named = (id: string) => value(id) || null;
  const body = JSON.stringify({
    input: value("input"),
    output: value("output"),
    time: named("time"),
    first: Number(value("first")),
    last: value("last") ? Number(value("last")) : null,
    skip: Number(value("skip")),
    start: value("begin"),
    curves: named("curves"),
    start_of_curve: named("curves") && named("start-of-curve"),
    groups: named("groups"),
    levels: value("levels") ? Number(value("levels")) : "auto",
    diagonal: value("diagonal"),
    slope: slope === "auto" ? slope : slope === "true",
    holdout: Number(value("holdout")),
    lag: lag === "auto" ? lag : Number(lag),
    spacing: value("spacing"),
    dynamics: value("dynamics"),
    creep: value("creep"),
    rate: value("rate") === "true",
  });
  const button = byId<HTMLButtonElement>("identify");
  button.disabled = true;
  stage("sending");
  try {
    const answer = await fetch(`/api/lab/${user}/identify`, { method: "POST", body });
    if (!answer.ok || !answer.body) {
      trouble((await answer.json()).error);
      return;
    }
    show("get-report", false);
    byId("report-note").textContent = "the report is being written…";
    for await (const reply of lines(answer.body)) receive(reply);
  } catch {
    trouble("The server of this page does not answer; is minorloop lab still running?");
  } finally {
    button.disabled = false;
    window.clearInterval(clock);
    show("working", false);
  }
}

async function* lines(body: ReadableStream<Uint8Array>): AsyncGenerator<Answer> {
  const reader = body.pipeThrough(new TextDecoderStream() as ReadableWritablePair<string, Uint8Array>).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    rest += value ?? "";
    const parts = rest.split("\n");
    rest = parts.pop()!;
    for (const part of parts) yield JSON.parse(part) as Answer;
    if (done) return;
  }
}

function receive(answer: Answer): void {
  if (answer.stage) stage(answer.stage);
  if (answer.error) trouble(answer.error);
  if (answer.result) showResult(answer.result);
  if (answer.report) {
    byId<HTMLAnchorElement>("get-report").href = `/api/lab/${user}/report.html`;
    show("get-report");
    byId("report-note").textContent = "";
  }
}

let clock = 0;

/** Show a stage and its seconds so far. */
function stage(name: string): void {
  show("working");
  const began = performance.now();
  const tell = () => {
    const seconds = Math.floor((performance.now() - began) / 1000);
    byId("stage").textContent = seconds > 0 ? `${name}… ${seconds} s` : `${name}…`;
  };
  window.clearInterval(clock);
  clock = window.setInterval(tell, 1000);
  tell();
}

function showResult(found: Result): void {
  result = found;
  memory = null;
  show("preview", false);
  show("result");
  document.body.dataset.model = String(found.scores.unknowns);
  byId<HTMLAnchorElement>("get-model").href = `/api/lab/${user}/model.json`;
  show("get-inputs", false);
  showScores(found);
  const { u, y, fit, joined } = found.loop;
  const curves = [{ y, colour: MEASURED, name: "measured", dots: true }, { y: fit, colour: MODEL, name: "model" }];
  const { lag } = found.scores;
  const before = lag ? `, ${lag} sample${lag === 1 ? "" : "s"} before` : "";
  loop("fit", u, curves, joined, found.input + before, found.output);
  along(found);
  byId("held-note").textContent = found.held === null ? "" : "– held-out data are to the right of the line";
  list("chosen", found.choices.map((choice) => `Chosen ${choice}.`));
  list("advice", found.advice.length ? found.advice : ["There is nothing to improve: the model explains the record."]);
  const [low, high] = found.range;
  const at = (share: number) => Number((low + share * (high - low)).toPrecision(3));
  byId<HTMLTextAreaElement>("targets").value = [0.3, 0.7, 0.5, 0.9, 0.4].map(at).join(", ");
  byId("sequence").replaceChildren();
  list("warnings", []);
  byId("slider-name").textContent = found.input;
  byId<HTMLInputElement>("slider").value = "0";
  forget();
}

/** Show sentences as the items of a list. */
function list(id: string, sentences: string[]): void {
  byId(id).replaceChildren(
    ...sentences.map((sentence) => {
      const item = document.createElement("li");
      item.textContent = sentence;
      return item;
    }),
  );
}

function showScores(found: Result): void {
  const rows = [...found.table, ["time", `${found.scores.seconds.toFixed(1)} s`]] as [string, string][];
  byId("scores").replaceChildren(
    ...rows.map(([name, value]) => {
      const box = document.createElement("div");
      if (name === "error on held-out data") box.className = "best";
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      [dt.textContent, dd.textContent] = [name, value];
      box.append(dt, dd);
      return box;
    }),
  );
}

interface Curve {
  y: (number | null)[];
  colour: string;
  name: string;
  dots?: boolean;
}

const [MEASURED, MODEL] = ["#ffb454", "#46d6b8"];

const AXIS = { stroke: "#b4c1c9", grid: { stroke: "#222b32", width: 1 }, ticks: { stroke: "#5b6b75", width: 1, size: 5 }, font: "11px system-ui", values: (_: uPlot, ticks: number[]) => ticks.map(shortNumber) };

function plot(id: string, options: Omit<uPlot.Options, "width" | "height">, data: uPlot.AlignedData): void {
  const box = byId(id);
  plots.get(id)?.destroy();
  const made = new uPlot({ ...options, width: box.clientWidth, height: box.clientHeight - 26 }, data, box);
  plots.set(id, made);
}

/**
 * Plot output over input. The path may go back, so its points are joined in their order, but not
 * across rows that were not measured. Points of a longer record are not joined.
 */
function loop(id: string, u: (number | null)[], curves: Curve[], joined: boolean, input: string, output: string): void {
  const path = (self: uPlot, series: number): null => {
    const [xs, ys] = self.data[series] as unknown as [(number | null)[], (number | null)[]];
    const context = self.ctx;
    context.save();
    context.beginPath();
    context.rect(self.bbox.left, self.bbox.top, self.bbox.width, self.bbox.height);
    context.clip();
    const { colour, dots } = curves[series - 1]!;
    const ratio = window.devicePixelRatio || 1;
    const radius = (dots ? 2 : 1) * ratio;
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 1.2 * ratio;
    context.beginPath();
    let pen = false;
    xs.forEach((x, k) => {
      const y = ys[k];
      const measured = x !== null && x !== undefined && y !== null && y !== undefined;
      if (measured) {
        const [px, py] = [self.valToPos(x, "x", true), self.valToPos(y, "y", true)];
        if (dots || !joined) context.fillRect(px - radius, py - radius, 2 * radius, 2 * radius);
        else if (pen) context.lineTo(px, py);
        else context.moveTo(px, py);
      }
      pen = measured;
    });
    context.stroke();
    context.restore();
    return null;
  };
  const all = curves.flatMap((curve) => curve.y).filter((value): value is number => value !== null);
  const inputs = u.filter((value): value is number => value !== null);
  const range = (values: number[]): [number, number] => {
    const [low, high] = [values.reduce((a, b) => Math.min(a, b), Infinity), values.reduce((a, b) => Math.max(a, b), -Infinity)];
    const gap = 0.04 * (high - low || 1);
    return [low - gap, high + gap];
  };
  plot(
    id,
    {
      mode: 2,
      legend: { live: false, markers: { width: 3 } },
      cursor: { show: false },
      scales: { x: { time: false, range: () => range(inputs) }, y: { range: () => range(all) } },
      axes: [{ ...AXIS, label: input, labelSize: 18, size: 34 }, { ...AXIS, label: output, labelSize: 18, size: 56 }],
      series: [{}, ...curves.map((curve) => ({ label: curve.name, stroke: curve.colour, paths: path as never, facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] }))],
    },
    [null, ...curves.map((curve) => [u, curve.y])] as unknown as uPlot.AlignedData,
  );
}

function along({ rows, y, fit, held, clock, output }: Result): void {
  const mark = (self: uPlot): void => {
    if (held === null) return;
    const x = self.valToPos(held, "x", true);
    self.ctx.save();
    self.ctx.strokeStyle = "#e6edf1";
    self.ctx.setLineDash([6, 6]);
    self.ctx.beginPath();
    self.ctx.moveTo(x, self.bbox.top);
    self.ctx.lineTo(x, self.bbox.top + self.bbox.height);
    self.ctx.stroke();
    self.ctx.restore();
  };
  plot(
    "along",
    {
      legend: { live: false },
      cursor: { drag: { x: true, y: false }, points: { show: false } },
      scales: { x: { time: false } },
      hooks: { draw: [mark] },
      axes: [{ ...AXIS, label: clock, labelSize: 18, size: 34 }, { ...AXIS, label: output, labelSize: 18, size: 56 }],
      series: [
        { label: clock },
        { label: "measured", stroke: MEASURED, paths: () => null, points: { show: true, size: 4, width: 0, fill: MEASURED } },
        { label: "model", stroke: MODEL, width: 1.2 },
      ],
    },
    [rows, y, fit] as uPlot.AlignedData,
  );
}

function drawMemory(): void {
  if (!result) return;
  const labels = { alpha: `on at, ${result.input}`, beta: `off at, ${result.input}`, margin: 46, numbers: true };
  drawPlane(byId<HTMLCanvasElement>("plane"), result, memory ?? [result.levels[0]!], labels);
}

function sliderInput(): number {
  const low = result!.levels[0]!;
  const high = result!.levels[result!.levels.length - 1]!;
  return low + (Number(byId<HTMLInputElement>("slider").value) / 1000) * (high - low);
}

let moving = false;
let again = false;

/** Apply the value of the slider to the model; one request at a time, the newest value last. */
async function move(): Promise<void> {
  if (!result) return;
  byId("slider-shown").textContent = sliderInput().toPrecision(4);
  if (moving) {
    again = true;
    return;
  }
  moving = true;
  const reply = await ask(`/api/lab/${user}/move`, JSON.stringify({ u: sliderInput(), memory }));
  moving = false;
  if (reply) {
    memory = reply.memory as number[];
    byId("slider-output").textContent = `${(reply.y as number).toPrecision(5)}`;
    drawMemory();
  }
  if (again) {
    again = false;
    void move();
  }
}

function forget(): void {
  memory = null;
  byId<HTMLInputElement>("slider").value = "0";
  byId("slider-output").textContent = "–";
  byId("slider-shown").textContent = "";
  drawMemory();
}

async function invert(): Promise<void> {
  trouble("");
  const words = byId<HTMLTextAreaElement>("targets").value.split(/[\s,;]+/).filter(Boolean);
  const targets = words.map(Number);
  const wrong = targets.findIndex((value) => !Number.isFinite(value));
  if (words.length === 0 || wrong >= 0) {
    trouble(words.length === 0 ? "There are no targets; type some numbers." : `“${words[wrong]}” is not a number; separate numbers by commas or spaces.`);
    return;
  }
  const start = byId<HTMLSelectElement>("start").value;
  const reply = await ask(`/api/lab/${user}/invert`, JSON.stringify({ targets, start }));
  byId("sequence").replaceChildren();
  list("warnings", reply?.warnings ?? []);
  show("get-inputs", false);
  if (!reply) return;
  const rows = targets.map((target, k) => [target, reply.u[k], reply.y[k]].map((value) => (value as number).toPrecision(6)));
  const table = byId<HTMLTableElement>("sequence");
  table.innerHTML = "<thead><tr><th>target</th><th>input</th><th>output</th></tr></thead>";
  const body = table.createTBody();
  rows.forEach((cells, k) => {
    const row = body.insertRow();
    if (!reply.reachable[k]) row.className = "out";
    cells.forEach((cell) => (row.insertCell().textContent = cell));
  });
  const missed = (reply.reachable as boolean[]).filter((ok) => !ok).length;
  if (missed) {
    const [low, high] = result!.range.map((value) => value.toPrecision(4));
    trouble(`${missed} of ${targets.length} targets are beyond what the model reaches, ${low} to ${high}; their inputs bring it as near as possible.`);
  }
  byId<HTMLAnchorElement>("get-inputs").href = `/api/lab/${user}/inputs.csv`;
  show("get-inputs");
}

if (location.pathname === "/") document.querySelector("nav")?.remove(); // it is served alone
const area = byId("drop");
const file = byId<HTMLInputElement>("file");
byId("browse").onclick = () => file.click();
file.onchange = () => {
  if (file.files?.[0]) void drop(file.files[0]);
  file.value = "";
};
for (const name of ["dragenter", "dragover"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    area.classList.add("over");
  });
}
for (const name of ["dragleave", "drop"]) document.addEventListener(name, () => area.classList.remove("over"));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  const dropped = event.dataTransfer?.files[0];
  if (dropped) void drop(dropped);
});
byId<HTMLFormElement>("choices").onsubmit = (event) => {
  event.preventDefault();
  void identify();
};
for (const id of ["input", "output"]) byId(id).onchange = drawLoop;
byId("slider").oninput = () => void move();
byId("forget").onclick = forget;
byId("invert").onclick = () => void invert();
window.addEventListener("resize", () => {
  for (const [id, made] of plots) made.setSize({ width: byId(id).clientWidth, height: byId(id).clientHeight - 26 });
  drawMemory();
});
