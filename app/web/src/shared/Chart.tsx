/**
 * A chart that everybody can read: bands of one sigma, zoom by dragging, a cursor that others can follow or set.
 *
 *     const link = chartLink();                       // shared by charts of one axis, and by a map
 *     <Chart title="Height" axis="distance" x={alongM} unit="m" link={link}
 *            lines={[{ label: "measured", values: heights, sigma: sigmas, colour: "measured", unit: "m" }]} />
 *
 * `x` ascends. It is drawn anew when `x` or `lines` are other objects, so keep them (useMemo). Without a link, `cursor` sets
 * where the cursor is, and `onHover` is told where it went, null when it left. `link.at` and `link.range` hold both.
 * Keyboard: the slider below reads off every place in words; plus, minus and 0 zoom. Shift and dragging pans.
 */
import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useId, useMemo, useRef } from "preact/hooks";
import type uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import "./chart/chart.css";
import { ChartTable } from "./chart/ChartTable";
import { columnOf, draw } from "./chart/draw";
import {
  type Axis,
  type ChartLink,
  chartLink,
  type Line,
  nearest,
  place,
  type Stretch,
  written,
} from "./chart/lines";
import { pannedByDrag, touched, zoomedRange } from "./chart/moves";
import { t } from "./texts";
import { theme } from "./theme";

export { type ChartLink, chartLink, type Line, type Stretch } from "./chart/lines";

export interface ChartProps {
  title: string;
  axis: Axis;
  x: ArrayLike<number>;
  lines: readonly Line[];
  /** Of the left scale. */
  unit?: string;
  /** Where the left scale begins, unless a value lies below; else where the values do. */
  floor?: number;
  /** Stretches of the axis that stand out; drawn anew when it is another object. */
  stretches?: readonly Stretch[];
  height?: number;
  link?: ChartLink;
  cursor?: number | null;
  onHover?: (x: number | null) => void;
  /** Short and simple: no zoom, no table. */
  plain?: boolean;
}

const NONE: readonly Stretch[] = [];

/** Put the cursor at a place; nobody is told. */
function pointAt(chart: uPlot, x: ArrayLike<number>, at: number | null): void {
  const there = (chart.cursor.left ?? -1) >= 0 && chart.cursor.idx != null;
  if (at === null ? !there : there && x[chart.cursor.idx as number] === at) return;
  chart.setCursor({ left: at === null ? -10 : chart.valToPos(at, "x"), top: at === null ? -10 : 1 }, false);
}

export function Chart(props: ChartProps) {
  const {
    title,
    axis,
    x,
    lines,
    unit,
    floor,
    stretches = NONE,
    height = 200,
    onHover,
    plain = false,
  } = props;
  const own = useMemo(chartLink, []);
  const link = props.link ?? own;
  const into = useRef<HTMLDivElement>(null);
  const chart = useRef<uPlot | null>(null);
  const hoverHandler = useRef(onHover);
  hoverHandler.current = onHover;
  const off = useSignal<ReadonlySet<string>>(
    new Set(lines.filter((one) => one.hidden).map((one) => one.label)),
  );
  // Lines may come later: what is not asked for of them stays hidden, too.
  const met = useRef(new Set(lines.map((one) => one.label)));
  const late = lines.filter((one) => !met.current.has(one.label));
  for (const one of late) met.current.add(one.label);
  if (late.some((one) => one.hidden))
    off.value = new Set([...off.peek(), ...late.filter((one) => one.hidden).map((one) => one.label)]);
  const help = useId();
  const chosen = theme.value;

  const hover = (index: number | null) => {
    const at = index === null ? null : (x[index] ?? null);
    if (at === link.at.peek()) return;
    link.at.value = at;
    hoverHandler.current?.(at);
  };

  useEffect(() => {
    const host = into.current;
    if (!host || x.length === 0) return;
    const all: [number, number] = [x[0] as number, x[x.length - 1] as number];
    const shown = lines.map((line) => ({ ...line, hidden: off.peek().has(line.label) }));
    const drawing = { title, x, lines: shown, axis, unit, height, stretches, floor };
    let ready = false;
    const plot = draw(drawing, host, hover, ([low, high]) => {
      if (!ready) return;
      const whole = low <= all[0] && high >= all[1];
      const before = link.range.peek();
      if (whole ? before !== null : before?.[0] !== low || before[1] !== high)
        link.range.value = whole ? null : [low, high];
    });
    chart.current = plot;
    const range = link.range.peek();
    if (range) plot.setScale("x", { min: range[0], max: range[1] });
    queueMicrotask(() => {
      ready = true;
      pointAt(plot, x, link.at.peek());
    });
    const sized = new ResizeObserver(() => {
      if (host.clientWidth > 0 && Math.abs(host.clientWidth - plot.width) > 1)
        plot.setSize({ width: host.clientWidth, height });
    });
    sized.observe(host);
    const still = [touched(plot, hover), pannedByDrag(plot, all)];
    return () => {
      for (const end of still) end();
      sized.disconnect();
      plot.destroy();
      chart.current = null;
    };
  }, [x, lines, stretches, chosen, height, axis, unit, floor]);

  // The cursor of others, and of the slider.
  useSignalEffect(() => {
    const at = link.at.value;
    if (chart.current) pointAt(chart.current, x, at);
  });
  useSignalEffect(() => {
    const range = link.range.value;
    const plot = chart.current;
    if (!plot || x.length === 0) return;
    const [min, max] = range ?? [x[0] as number, x[x.length - 1] as number];
    if (plot.scales["x"]?.min !== min || plot.scales["x"]?.max !== max) plot.setScale("x", { min, max });
  });
  const { cursor } = props;
  useEffect(() => {
    if (cursor !== undefined) link.at.value = cursor;
  }, [cursor, link]);

  const flip = (label: string) => {
    const next = new Set(off.value);
    if (!next.delete(label)) next.add(label);
    off.value = next;
    lines.forEach((line, n) => {
      const first = columnOf(lines, n);
      const end = columnOf(lines, n + 1);
      for (let k = first; k < end; k += 1) chart.current?.setSeries(k, { show: !next.has(line.label) });
    });
  };

  if (x.length === 0) return <p class="quiet-text">{t("chart.nothing")}</p>;
  const all: [number, number] = [x[0] as number, x[x.length - 1] as number];
  const range = link.range.value;
  const [first, last] = (range ?? all).map((end) => nearest(x, end)) as [number, number];
  const at = link.at.value === null ? null : nearest(x, link.at.value);
  const zoom = (by: number, shift = 0) => {
    link.range.value = zoomedRange(all, link.range.peek(), link.at.peek(), by, shift);
  };
  const read = (index: number) =>
    [
      place(axis, x[index] as number),
      ...lines
        .filter((line) => !off.value.has(line.label))
        .map((line) => `${line.label} ${written(line, index)}`),
    ].join("; ");

  return (
    <figure class="chart" aria-label={title}>
      <figcaption>
        <h3>{title}</h3>
        <span class="quiet-text chart-at">{at === null ? "" : place(axis, x[at] as number)}</span>
        {!plain && (
          <fieldset class="chart-zoom" aria-label={t("chart.zoom", { title })}>
            {range && (
              <>
                <button type="button" aria-label={t("chart.earlier")} onClick={() => zoom(1, -0.5)}>
                  ←
                </button>
                <button type="button" aria-label={t("chart.later")} onClick={() => zoom(1, 0.5)}>
                  →
                </button>
                <button type="button" aria-label={t("chart.zoom_out")} onClick={() => zoom(2)}>
                  −
                </button>
              </>
            )}
            <button type="button" aria-label={t("chart.zoom_in")} onClick={() => zoom(0.5)}>
              +
            </button>
            {range && (
              <button type="button" onClick={() => (link.range.value = null)}>
                {t("chart.all")}
              </button>
            )}
          </fieldset>
        )}
      </figcaption>
      <ul class="chart-lines">
        {lines.map((line) => (
          <li key={line.label}>
            <button
              type="button"
              class="quiet"
              aria-pressed={!off.value.has(line.label)}
              title={t("chart.hide", { label: line.label })}
              onClick={() => flip(line.label)}
            >
              <span
                class={`chart-key ${line.points ? "points" : line.dashed ? "dashed" : ""}`}
                style={{ "--key": `var(--chart-${line.colour})` }}
              />
              {line.label}
              <b>{at === null ? "" : written(line, at)}</b>
            </button>
          </li>
        ))}
      </ul>
      <div class="chart-place" ref={into} aria-hidden="true" />
      <input
        type="range"
        min={first}
        max={Math.max(last, first)}
        value={at ?? first}
        aria-label={t("chart.read", { title })}
        aria-valuetext={read(at ?? first)}
        aria-describedby={plain ? undefined : help}
        onInput={(event) => hover(Number(event.currentTarget.value))}
        onKeyDown={(event) => {
          const by = { "+": 0.5, "=": 0.5, "-": 2, "0": 0 }[event.key];
          if (by === undefined || plain) return;
          event.preventDefault();
          if (by === 0) link.range.value = null;
          else zoom(by);
        }}
      />
      {!plain && (
        <>
          <span id={help} class="unseen">
            {t("chart.keys")}
          </span>
          <ChartTable title={title} axis={axis} x={x} lines={lines} first={first} last={last} />
        </>
      )}
    </figure>
  );
}
