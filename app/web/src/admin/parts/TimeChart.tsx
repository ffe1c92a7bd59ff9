/** Lines over time, with the figures below it for other programs. */
import { useMemo } from "preact/hooks";
import { Chart, type Line } from "../../shared/Chart";
import { t } from "../../shared/texts";
import type { Lines } from "./series";

export * from "./series";

const COLOURS = ["measured", "danger", "model", "other", "fourth", "quiet"] as const;

/** So few places are no line. */
const FEW = 3;

interface ChartProps extends Lines {
  title: string;
  unit: string;
  csv: string;
  /** Whether each place is a day, not a moment. */
  daily: boolean;
}

export function TimeChart({ times, lines, title, unit, csv, daily }: ChartProps) {
  const same = JSON.stringify([times, lines]);
  const [x, drawn] = useMemo(
    (): [number[], Line[]] => [
      times,
      lines.map((line, k) => ({
        ...line,
        colour: COLOURS[k % COLOURS.length] ?? "quiet",
        dashed: k > 2,
        points: times.length < FEW,
        unit,
        decimals: unit === "" ? 0 : 1,
      })),
    ],
    [same, unit],
  );
  if (times.length === 0) return null;
  return (
    <>
      <Chart title={title} axis={daily ? "day" : "moment"} x={x} lines={drawn} unit={unit} floor={0} />
      <p class="below">
        <a href={csv} download>
          {t("admin.table.csv", { name: title })}
        </a>
      </p>
    </>
  );
}
