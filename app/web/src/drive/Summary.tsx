/** What came out of a drive at a glance, its warnings, and its files. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { distance, duration, moment, number, size } from "../shared/format";
import { remarksOf } from "../shared/remarks";
import { t } from "../shared/texts";
import { doubtOf } from "./Columns";
import { addressOf, type Drive, type Report } from "./data";
import { ride } from "./ride";
import { Scrolled } from "./Scrolled";
import { allFigures, sentencesOf, versionsOf } from "./sentences";
import { kinds, profile } from "./state";
import { shares } from "./stretches";

function Figure({ name, children }: { name: string; children: ComponentChildren }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>{children}</dd>
    </div>
  );
}

function share(of: number): string {
  return of > 0 && of < 0.001 ? "< 0.1 %" : `${number(100 * of, of > 0 && of < 0.1 ? 1 : 0)} %`;
}

export function Figures({ drive }: { drive: Drive }) {
  const report = (drive.report ?? {}) as Report;
  const sigma = report["median_slope_sigma_percent"] as number | null | undefined;
  const parts = profile.value ? shares(profile.value, kinds.value) : null;
  const matched = report["matched_share"];
  return (
    <dl class="figures">
      <Figure name={t("drive.figure.driven")}>{moment(drive.drive_time)}</Figure>
      {!ride.value && (
        <Figure name={t("drive.figure.length")}>
          {distance(drive.distance_m)}, {duration(report["duration_s"] as number | undefined)}
        </Figure>
      )}
      <Figure name={t("drive.figure.segments")}>
        {number(report["segments_estimated"] as number | undefined)}
      </Figure>
      <Figure name={t("drive.figure.sigma")}>
        {number(sigma, 2)}
        {sigma == null ? "" : " %"}
      </Figure>
      <Figure name={t("drive.figure.rejected")}>
        <a href="#contradictions">{number(report["rejected_segments"] as number | undefined)}</a>
      </Figure>
      {parts && (
        <Figure name={t("drive.figure.unmatched")}>
          {share(typeof matched === "number" ? 1 - matched : parts.unmatched)} · {share(parts.blind)}
        </Figure>
      )}
      <Figure name={t("drive.figure.method")}>{drive.method}</Figure>
      <Figure name={t("drive.figure.uploaded")}>{moment(drive.created_at)}</Figure>
    </dl>
  );
}

/** What the log alone says, of a drive that has no result yet. */
export function LogFigures({ drive }: { drive: Drive }) {
  const times = profile.value?.time_s ?? [];
  return (
    <dl class="figures">
      <Figure name={t("drive.figure.driven")}>{moment(drive.drive_time)}</Figure>
      <Figure name={t("drive.figure.length")}>
        {distance(drive.distance_m)}, {duration((times.at(-1) ?? 0) - (times[0] ?? 0))}
      </Figure>
      <Figure name={t("drive.figure.uploaded")}>{moment(drive.created_at)}</Figure>
    </dl>
  );
}

/** What a person should know or do, as the service says it: what is to be done first. One line until it is opened. */
export function Remarks({ drive }: { drive: Drive }) {
  // What is odd about its heights has a card of its own.
  const warnings = remarksOf(drive.report).filter(
    (one) => one.key !== "drive.altitudes_off" || doubtOf(drive) === null,
  );
  if (warnings.length === 0 && !drive.duplicate_of) return null;
  const toDo = warnings.filter((one) => one.asks);
  const others = warnings.filter((one) => !one.asks);
  return (
    <details class="card drive-remarks">
      <summary>
        <h2>{t("drive.remarks", { n: Math.max(warnings.length, 1) })}</h2>
        {toDo.length > 0 && <span class="warn-text">{t("drive.remarks_to_do", { n: toDo.length })}</span>}
      </summary>
      <ul>
        {[...toDo, ...others].map(({ text }) => (
          <li key={text}>{text}</li>
        ))}
      </ul>
      {drive.duplicate_of && (
        <p>
          <a href={`/drives/${drive.duplicate_of}`}>{t("drive.duplicate_of")}</a>
        </p>
      )}
    </details>
  );
}

export function ReportCard({ drive }: { drive: Drive }) {
  const report = drive.report as Report | null;
  if (!report) return null;
  const options = Object.entries((report["options"] ?? drive.options) as Record<string, unknown>);
  return (
    <section class="card" aria-labelledby="report">
      <h2 id="report">{t("drive.report.title")}</h2>
      <div class="drive-topics">
        {sentencesOf(report).map(([topic, sentences]) => (
          <section key={topic}>
            <h3>{t(`drive.report.topic.${topic}`)}</h3>
            <ul>
              {sentences.map((one) => (
                <li key={one}>{one}</li>
              ))}
            </ul>
          </section>
        ))}
        <section>
          <h3>{t("drive.report.topic.versions")}</h3>
          <ul>
            <li>{versionsOf(report)}</li>
            <li>
              {t("drive.report.options", {
                method: drive.method,
                options:
                  options.map(([name, value]) => `${name} = ${JSON.stringify(value)}`).join(", ") || "–",
              })}
            </li>
          </ul>
        </section>
      </div>
      <details>
        <summary>{t("drive.report.all")}</summary>
        <Scrolled name={t("drive.report.all")}>
          <table>
            <thead>
              <tr>
                <th scope="col">{t("drive.report.figure")}</th>
                <th scope="col">{t("drive.report.value")}</th>
              </tr>
            </thead>
            <tbody lang="en">
              {allFigures(report).map(([name, value]) => (
                <tr key={name}>
                  <th scope="row">{name}</th>
                  <td>{value}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </Scrolled>
      </details>
    </section>
  );
}

const FILES = [
  ["track", ["geojson", "csv", "gpx"]],
  ["profile", ["json", "csv", "png"]],
  ["segments", ["geojson", "csv"]],
] as const;

export function Downloads({ drive }: { drive: Drive }) {
  const stem = drive.filename.replace(/\.[^.]*$/, "");
  const withoutEnds = useSignal(false);
  const ends = withoutEnds.value ? "&ends=hidden" : "";
  return (
    <section class="card" aria-labelledby="downloads">
      <h2 id="downloads">{t("drive.download.title")}</h2>
      <ul class="drive-files">
        {drive.log_deleted_at === null && (
          <li>
            <a href={addressOf(drive.id, "/log")} download={drive.filename}>
              {t("drive.download.log")}
            </a>{" "}
            <span class="quiet-text">{size(drive.size_bytes)}</span>
          </li>
        )}
        {drive.report !== null &&
          FILES.map(([part, formats]) => (
            <li key={part}>
              {t(`drive.download.${part}`)}{" "}
              {formats.map((format) => (
                <a
                  key={format}
                  href={addressOf(drive.id, `/${part}?f=${format}${ends}`)}
                  download={`${stem}-${part}.${format}`}
                  aria-label={t("drive.download.as", {
                    what: t(`drive.download.${part}`),
                    format: format.toUpperCase(),
                  })}
                >
                  {format.toUpperCase()}
                </a>
              ))}
            </li>
          ))}
      </ul>
      {drive.report !== null && (
        <>
          <label class="check">
            <input
              type="checkbox"
              checked={withoutEnds.value}
              aria-describedby="without-ends-help"
              onChange={(event) => {
                withoutEnds.value = event.currentTarget.checked;
              }}
            />
            <span>{t("drive.download.without_ends")}</span>
          </label>
          <p id="without-ends-help" class="quiet-text">
            {t("drive.download.without_ends_help")}
          </p>
        </>
      )}
    </section>
  );
}
