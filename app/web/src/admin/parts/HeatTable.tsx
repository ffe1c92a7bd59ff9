/** Kilometres by number of drives and sigma: the more, the stronger the colour; the figure stands in each cell. */
import { number } from "../../shared/format";
import { t } from "../../shared/texts";
import { queryAddress } from "../links";
import type { SigmaCount } from "../types";

const STRONGEST = 40; // percent of the accent: text stays readable on it

function drivesText(from: number): string {
  return from >= 8
    ? t("admin.sigmas.more", { from })
    : from === 1
      ? "1"
      : `${number(from)}–${number(2 * from - 1)}`;
}

export function HeatTable({ rows }: { rows: SigmaCount[] }) {
  const drives = [...new Set(rows.map((row) => row.drives_from))].sort((a, b) => a - b);
  const sigmas = [...new Set(rows.map((row) => row.sigma_from_percent))].sort((a, b) => a - b);
  const km = new Map(rows.map((row) => [`${row.drives_from} ${row.sigma_from_percent}`, row.km]));
  const shadeOf = (value: number, most: number) => Math.round(STRONGEST * Math.sqrt(value / (most || 1)));
  const caption = t("admin.sigmas.caption");
  return (
    <>
      {/* biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls must be reached by keyboard */}
      <section class="wide" aria-label={caption} tabIndex={0}>
        <table class="heat">
          <caption>{caption}</caption>
          <thead>
            <tr>
              <th scope="col">{t("admin.sigmas.drives")}</th>
              {sigmas.map((from) => (
                <th key={from} scope="col" class="number">
                  {t("admin.sigmas.from", { from: number(from, Number.isInteger(from) ? 0 : 1) })}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {drives.map((from) => {
              const values = sigmas.map((sigma) => km.get(`${from} ${sigma}`));
              const most = Math.max(...values.map((value) => value ?? 0));
              return (
                <tr key={from}>
                  <th scope="row">{drivesText(from)}</th>
                  {values.map((value, at) => (
                    <td
                      key={sigmas[at]}
                      class="number"
                      style={{
                        background: `color-mix(in srgb, var(--accent) ${shadeOf(value ?? 0, most)}%, var(--card))`,
                      }}
                    >
                      {value === undefined ? "–" : number(value, value < 10 ? 1 : 0)}
                    </td>
                  ))}
                </tr>
              );
            })}
          </tbody>
        </table>
      </section>
      <p class="below">
        <a href={queryAddress("sigmas")} download>
          {t("admin.table.csv", { name: caption })}
        </a>
      </p>
    </>
  );
}
