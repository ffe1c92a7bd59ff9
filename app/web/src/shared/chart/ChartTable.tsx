/** The same as a chart, as a table: some rows of what is zoomed to. */
import { useSignal } from "@preact/signals";
import { t } from "../texts";
import { type Axis, type Line, place, spread, written } from "./lines";

const ROWS = 41;

interface TableProps {
  title: string;
  axis: Axis;
  x: ArrayLike<number>;
  lines: readonly Line[];
  first: number;
  last: number;
}

export function ChartTable({ title, axis, x, lines, first, last }: TableProps) {
  const open = useSignal(false);
  const rows = open.value ? spread(first, last, ROWS) : [];
  return (
    <details
      onToggle={(event) => {
        open.value = event.currentTarget.open;
      }}
    >
      <summary>{t("chart.table")}</summary>
      {open.value && (
        <>
          {rows.length <= last - first && (
            <p class="quiet-text">{t("chart.table_part", { n: rows.length, all: last - first + 1 })}</p>
          )}
          {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard */}
          <section class="wide" tabIndex={0} aria-label={title}>
            <table>
              <thead>
                <tr>
                  <th scope="col" class="number">
                    {t(`chart.${axis}`)}
                  </th>
                  {lines.map((line) => (
                    <th key={line.label} scope="col" class="number">
                      {line.label}
                    </th>
                  ))}
                </tr>
              </thead>
              <tbody>
                {rows.map((row) => (
                  <tr key={row}>
                    <th scope="row" class="number">
                      {place(axis, x[row] as number)}
                    </th>
                    {lines.map((line) => (
                      <td key={line.label} class="number">
                        {written(line, row)}
                      </td>
                    ))}
                  </tr>
                ))}
              </tbody>
            </table>
          </section>
        </>
      )}
    </details>
  );
}
