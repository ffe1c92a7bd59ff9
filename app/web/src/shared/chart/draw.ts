/** Lines, bands and error bars as uPlot draws them. */
import uPlot from "uplot";
import { number } from "../format";
import { type Axis, type ChartColour, decimalsOf, known, type Line, type Stretch, ticks } from "./lines";

export interface Drawing {
  title: string;
  x: ArrayLike<number>;
  lines: readonly Line[];
  axis: Axis;
  unit: string | undefined;
  height: number;
  stretches: readonly Stretch[];
  /** Where the left scale begins, unless a value lies below. */
  floor: number | undefined;
}

const BAND = 0.22;
const STRETCH = 0.16;
const STRONG = 0.3;
/** Of a label of a stretch, from the top: pixels. */
const LABEL_PX = 14;
const FONT = "12px system-ui, sans-serif";

type Palette = (name: string) => string;

/** The colours of the page as it is now. */
function palette(within: Element): Palette {
  const style = getComputedStyle(within);
  return (name) => style.getPropertyValue(`--${name}`).trim() || "#888888";
}

const ofLine = (colour: ChartColour) => `chart-${colour}`;

/** A colour `#rrggbb` that lets through what is below it. */
export function faded(colour: string, alpha: number): string {
  const parts = [1, 3, 5].map((at) => Number.parseInt(colour.slice(at, at + 2), 16));
  return `rgba(${parts.map((part) => (Number.isNaN(part) ? 128 : part)).join(", ")}, ${alpha})`;
}

/** How many columns of data a line takes: itself, and both rims of its band. */
const columns = (line: Line) => (line.sigma && !line.points ? 3 : 1);

/** The number of a line's first column; 0 is the horizontal axis. */
export function columnOf(lines: readonly Line[], which: number): number {
  return lines.slice(0, which).reduce((sum, line) => sum + columns(line), 1);
}

function data({ x, lines }: Drawing): uPlot.AlignedData {
  const all: (number | null)[][] = [];
  for (const line of lines) {
    const value = (shift: number) =>
      Array.from({ length: x.length }, (_, n) => {
        const middle = known(line.values, n);
        if (shift === 0 || middle === null) return middle;
        const sigma = known(line.sigma, n);
        return sigma === null ? null : middle + shift * sigma;
      });
    all.push(value(0));
    if (columns(line) === 3) all.push(value(1), value(-1));
  }
  return [Array.from(x), ...all] as uPlot.AlignedData;
}

function series({ lines }: Drawing, colour: Palette): uPlot.Series[] {
  const all: uPlot.Series[] = [{}];
  for (const line of lines) {
    const stroke = colour(ofLine(line.colour));
    const scale = line.axis === "right" ? "right" : "left";
    const show = !line.hidden;
    all.push({
      label: line.label,
      scale,
      show,
      stroke,
      width: 2,
      ...(line.dashed ? { dash: [6, 4] } : {}),
      ...(line.points
        ? { paths: () => null, points: { show: true, size: line.dot ?? 7, fill: stroke } }
        : { points: { show: false } }),
    });
    const rim: uPlot.Series = { scale, show, stroke: "transparent", width: 0, points: { show: false } };
    if (columns(line) === 3) all.push({ ...rim }, { ...rim });
  }
  return all;
}

function bands({ lines }: Drawing, colour: Palette): uPlot.Band[] {
  return lines.flatMap((line, n) => {
    if (columns(line) !== 3) return [];
    const first = columnOf(lines, n);
    return [{ series: [first + 1, first + 2], fill: faded(colour(ofLine(line.colour)), BAND) }];
  });
}

/** A vertical scale: no closer than a twentieth of its unit, with room for error bars. */
function range(drawing: Drawing, scale: "left" | "right"): uPlot.Scale.Range {
  const own = drawing.lines.filter((line) => (line.axis === "right" ? "right" : "left") === scale);
  const reach = own
    .filter((line) => line.points && line.sigma)
    .flatMap((line) => Array.from(line.sigma ?? [], finite))
    .reduce((most, one) => Math.max(most, one), 0);
  return (_chart, low, high) => {
    // Without a line that is shown there is no scale either.
    if (low === null || high === null || !Number.isFinite(low)) return [null, null];
    const spare = Math.max((high - low) * 0.08, 0.05) + reach;
    const floor = scale === "left" ? drawing.floor : undefined;
    return [floor !== undefined && low >= floor ? floor : low - spare, high + spare];
  };
}

const finite = (value: number | null | undefined) =>
  value !== null && value !== undefined && Number.isFinite(value) ? value : 0;

function axes(drawing: Drawing, colour: Palette): uPlot.Axis[] {
  const look = { stroke: colour("quiet"), font: FONT, grid: { stroke: colour("line"), width: 1 } };
  const marks = { stroke: colour("line"), width: 1, size: 4 };
  const heights = (unit: string | undefined) => (_chart: uPlot, splits: number[]) => {
    const step = Math.abs((splits[1] ?? 1) - (splits[0] ?? 0));
    const decimals = decimalsOf(step);
    return splits.map((value) => `${number(value, decimals)}${unit ? ` ${unit}` : ""}`);
  };
  const width = (_chart: uPlot, values: string[] | null) =>
    14 + 7 * Math.max(3, ...(values ?? []).map((one) => one.length));
  const right = drawing.lines.filter((line) => line.axis === "right");
  const all: uPlot.Axis[] = [
    {
      ...look,
      ticks: marks,
      size: 28,
      space: 70,
      values: (chart, splits) =>
        ticks(drawing.axis, splits, (chart.scales["x"]?.max ?? 1) - (chart.scales["x"]?.min ?? 0)),
      ...(drawing.axis === "elapsed"
        ? { incrs: [1, 5, 10, 30, 60, 300, 600, 1800, 3600, 7200, 14_400] }
        : {}),
      ...(drawing.axis === "day"
        ? { incrs: [1, 2, 3, 7, 14, 31, 61, 92, 183, 365].map((days) => days * 86_400) }
        : {}),
    },
    { ...look, ticks: marks, scale: "left", size: width, values: heights(drawing.unit), space: 32 },
  ];
  if (right.length > 0)
    all.push({
      ...look,
      grid: { show: false },
      ticks: marks,
      scale: "right",
      side: 1,
      size: width,
      values: heights(right[0]?.unit),
      space: 32,
    });
  return all;
}

function drawStretches(drawing: Drawing, colour: Palette) {
  return (chart: uPlot) => {
    const { ctx, bbox } = chart;
    ctx.save();
    for (const one of drawing.stretches) {
      const from = Math.max(chart.valToPos(one.from, "x", true), bbox.left);
      const to = Math.min(chart.valToPos(one.to, "x", true), bbox.left + bbox.width);
      if (to <= from) continue;
      ctx.fillStyle = faded(colour(ofLine(one.colour)), one.strong ? STRONG : STRETCH);
      ctx.fillRect(from, bbox.top, to - from, bbox.height);
      if (one.label) {
        ctx.fillStyle = colour("text");
        ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
        ctx.textAlign = "center";
        ctx.fillText(one.label, (from + to) / 2, bbox.top + LABEL_PX * devicePixelRatio);
      }
    }
    ctx.restore();
  };
}

function drawBars(drawing: Drawing, colour: Palette) {
  return (chart: uPlot) => {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    drawing.lines.forEach((line, n) => {
      if (!line.points || !line.sigma || !chart.series[columnOf(drawing.lines, n)]?.show) return;
      ctx.strokeStyle = colour(ofLine(line.colour));
      ctx.lineWidth = 1.5 * devicePixelRatio;
      for (let k = 0; k < drawing.x.length; k += 1) {
        const value = known(line.values, k);
        const sigma = known(line.sigma, k);
        if (value === null || sigma === null) continue;
        const x = chart.valToPos(drawing.x[k] as number, "x", true);
        const scale = line.axis === "right" ? "right" : "left";
        ctx.beginPath();
        ctx.moveTo(x, chart.valToPos(value - sigma, scale, true));
        ctx.lineTo(x, chart.valToPos(value + sigma, scale, true));
        ctx.stroke();
      }
    });
    ctx.restore();
  };
}

/** Draw it into an element; `moved` is told where the cursor is, `zoomed` what is shown of the horizontal axis. */
export function draw(
  drawing: Drawing,
  into: HTMLElement,
  moved: (index: number | null) => void,
  zoomed: (range: [number, number]) => void,
): uPlot {
  const colour = palette(into);
  const options: uPlot.Options = {
    width: Math.max(into.clientWidth, 160),
    height: drawing.height,
    legend: { show: false },
    padding: [8, 16, 0, 0],
    cursor: {
      y: false,
      drag: { x: true, y: false, setScale: true, dist: 6 },
      points: { size: 7 },
      // Shift drags what is shown (Chart.tsx), the pointer alone chooses what to zoom to.
      bind: { mousedown: (_chart, _target, handle) => (event) => (event.shiftKey ? null : handle(event)) },
    },
    scales: {
      x: {
        time: false,
        ...(drawing.axis === "moment" || drawing.axis === "day" ? { range: momentRange } : {}),
      },
      left: { range: range(drawing, "left") },
      right: { range: range(drawing, "right") },
    },
    series: series(drawing, colour),
    bands: bands(drawing, colour),
    axes: axes(drawing, colour),
    hooks: {
      drawClear: [drawStretches(drawing, colour)],
      draw: [drawBars(drawing, colour)],
      setCursor: [(chart) => moved(chart.cursor.idx ?? null)],
      setScale: [
        (chart, key) => {
          const { min, max } = chart.scales["x"] ?? {};
          if (key === "x" && min != null && max != null) zoomed([min, max]);
        },
      ],
    },
  };
  return new uPlot(options, data(drawing), into);
}

/** Dots at the first and last moment are not cut in half. */
const momentRange: uPlot.Scale.Range = (_chart, low, high) => {
  if (low === null || high === null) return [0, 1];
  // A single moment stands in the middle of its day.
  const spare = high > low ? Math.max((high - low) * 0.04, 60) : 43_200;
  return [low - spare, high + spare];
};
