/** What moves a chart besides the mouse alone: fingers, shift and dragging, buttons. */
import type uPlot from "uplot";

/** A finger moves the cursor; returns what ends it. */
export function touched(chart: uPlot, moved: (index: number | null) => void): () => void {
  const over = chart.over;
  const follow = (event: TouchEvent) => {
    const finger = event.touches[0];
    if (!finger || event.touches.length > 1) return;
    const left = finger.clientX - over.getBoundingClientRect().left;
    chart.setCursor({ left, top: 1 }, false);
    moved(chart.cursor.idx ?? null);
  };
  over.addEventListener("touchstart", follow, { passive: true });
  over.addEventListener("touchmove", follow, { passive: true });
  return () => {
    over.removeEventListener("touchstart", follow);
    over.removeEventListener("touchmove", follow);
  };
}

/** Shift and dragging moves what is zoomed to, within all that there is; returns what ends it. */
export function pannedByDrag(chart: uPlot, all: [number, number]): () => void {
  const over = chart.over;
  const start = (event: PointerEvent) => {
    const { min, max } = chart.scales["x"] ?? {};
    if (!event.shiftKey || min == null || max == null) return;
    over.setPointerCapture(event.pointerId);
    const per = (max - min) / Math.max(over.clientWidth, 1);
    const move = (now: PointerEvent) => {
      const [low, high] = within(all, min - (now.clientX - event.clientX) * per, max - min);
      chart.setScale("x", { min: low, max: high });
    };
    const end = () => {
      over.removeEventListener("pointermove", move);
      over.removeEventListener("pointerup", end);
      over.removeEventListener("pointercancel", end);
    };
    over.addEventListener("pointermove", move);
    over.addEventListener("pointerup", end);
    over.addEventListener("pointercancel", end);
  };
  over.addEventListener("pointerdown", start);
  return () => over.removeEventListener("pointerdown", start);
}

/** The stretch of that length from `low` on, pushed inside. */
function within(all: [number, number], low: number, span: number): [number, number] {
  const first = Math.min(Math.max(low, all[0]), Math.max(all[1] - span, all[0]));
  return [first, Math.min(first + span, all[1])];
}

/** What is seen after zooming by a factor around the cursor, or moving by a share; null: all. */
export function zoomedRange(
  all: [number, number],
  now: [number, number] | null,
  at: number | null,
  by: number,
  shift = 0,
): [number, number] | null {
  const [low, high] = now ?? all;
  const inside = at !== null && at >= low && at <= high;
  const centre = inside && shift === 0 ? at : (low + high) / 2;
  const span = (high - low) * by;
  if (span >= all[1] - all[0]) return null;
  const from = shift === 0 ? centre - (centre - low) * by : low + shift * span;
  return within(all, from, span);
}
