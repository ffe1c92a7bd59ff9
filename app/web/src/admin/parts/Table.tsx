/** A table of figures: its name above it, numbers to the right, and a box of its own to scroll in. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { t } from "../../shared/texts";

export interface Column<Row> {
  title: string;
  /** Whether it holds numbers. */
  number?: boolean;
  cell: (row: Row, index: number) => ComponentChildren;
}

interface TableProps<Row> {
  caption: string;
  columns: Column<Row>[];
  rows: Row[];
  /** What stands there if there is no row. */
  none?: string;
  /** Where the same is for other programs. */
  csv?: string;
  /** How many rows are shown at first. */
  most?: number;
}

export function Table<Row>({ caption, columns, rows, none, csv, most = 15 }: TableProps<Row>) {
  const [all, setAll] = useState(false);
  if (rows.length === 0) return <p class="quiet-text">{none ?? t("admin.table.none")}</p>;
  const shown = all ? rows : rows.slice(0, most);
  return (
    <>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls must be reached by keyboard */}
      <section class="wide" aria-label={caption} tabIndex={0}>
        <table>
          <caption>{caption}</caption>
          <thead>
            <tr>
              {columns.map((one) => (
                <th key={one.title} scope="col" class={one.number ? "number" : undefined}>
                  {one.title}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {shown.map((row, index) => (
              <tr key={index}>
                {columns.map((one, at) =>
                  at === 0 ? (
                    <th key={one.title} scope="row" class={one.number ? "number" : undefined}>
                      {one.cell(row, index)}
                    </th>
                  ) : (
                    <td key={one.title} class={one.number ? "number" : undefined}>
                      {one.cell(row, index)}
                    </td>
                  ),
                )}
              </tr>
            ))}
          </tbody>
        </table>
      </section>
      <p class="below">
        {rows.length > shown.length && (
          <button type="button" onClick={() => setAll(true)}>
            {t("admin.table.all", { n: rows.length })}
          </button>
        )}
        {csv && (
          <a href={csv} download>
            {t("admin.table.csv", { name: caption })}
          </a>
        )}
      </p>
    </>
  );
}
