/** The drives behind a segment: what each says, whether it is accepted, and how the slope came together. */
import { useEffect, useMemo, useState } from "preact/hooks";
import { Chart, type Line } from "../shared/Chart";
import { moment, number, slope } from "../shared/format";
import { LogIn } from "../shared/LoggedIn";
import { errorText } from "../shared/Messages";
import { may } from "../shared/session";
import { t } from "../shared/texts";
import { Dates } from "./Dates";
import { loadObservations, type Observation, type Segment } from "./data";
import { together } from "./history";
import { decimalsOf, share } from "./words";

interface Read {
  drives: Observation[];
  next: string | null;
  state: "asking" | "there" | "failed";
  why: string;
}

const NOTHING: Read = { drives: [], next: null, state: "asking", why: "" };

export function Drives({ segment }: { segment: Segment }) {
  const [read, set] = useState<Read>(NOTHING);
  const [wanted, want] = useState<string | null>(null);
  useEffect(() => {
    const ended = new AbortController();
    set((before) => ({ ...before, state: "asking" }));
    loadObservations(segment.id, wanted, ended.signal).then(
      (page) =>
        set((before) => ({
          drives: [...(wanted === null ? [] : before.drives), ...page.observations],
          next: page.next,
          state: "there",
          why: "",
        })),
      (error) => {
        if (!ended.signal.aborted) set((before) => ({ ...before, state: "failed", why: errorText(error) }));
      },
    );
    return () => ended.abort();
  }, [segment.id, wanted]);

  const all = segment.properties.drives;
  // Of others' drives the slope knows, and the list does not.
  const whole = read.next === null && (may("operate") || read.drives.length >= all);
  return (
    <>
      <h3 id="drives-behind">{t("segment.behind")}</h3>
      <p class="quiet-text small" role="status">
        {read.state === "asking"
          ? t("segment.asking")
          : t("segment.listed", { n: read.drives.length, all: Math.max(all, read.drives.length) })}
      </p>
      {!may("operate") && <p class="quiet-text small">{t("segment.only_yours")}</p>}
      {read.state === "failed" && <p class="error-text">{read.why}</p>}
      {read.drives.length > 0 && <Table drives={read.drives} />}
      {read.next !== null && (
        <button type="button" disabled={read.state === "asking"} onClick={() => want(read.next)}>
          {t("segment.more")}
        </button>
      )}
      <p class="quiet-text small">{t("segment.rejected_note")}</p>
      {read.drives.length > 0 && <History segment={segment} drives={read.drives} whole={whole} />}
      {read.drives.length > 1 && <Dates drives={read.drives} />}
    </>
  );
}

/** In their place for who has shown no key. */
export function DrivesAfterLogin() {
  return (
    <>
      <h3>{t("segment.behind")}</h3>
      <p class="quiet-text small">
        {t("segment.log_in_why")} <LogIn text={t("segment.log_in")} />
      </p>
    </>
  );
}

function statusOf(one: Observation): "accepted" | "rejected" | "averaged" {
  return one.accepted === null ? "averaged" : one.accepted ? "accepted" : "rejected";
}

function Table({ drives }: { drives: Observation[] }) {
  return (
    // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard
    <section class="wide" tabIndex={0} aria-labelledby="drives-behind">
      <table>
        <thead>
          <tr>
            <th scope="col">{t("segment.when")}</th>
            <th scope="col" class="number">
              {t("segment.says")}
            </th>
            <th scope="col">{t("segment.accepted_title")}</th>
            <th scope="col" class="number">
              {t("segment.weight")}
            </th>
            <th scope="col">{t("segment.method")}</th>
          </tr>
        </thead>
        <tbody>
          {drives.map((one) => (
            <tr key={one.drive_id} class={statusOf(one)}>
              <th scope="row">
                <a href={`/drives/${one.drive_id}`}>{moment(one.first_at)}</a>
              </th>
              <td class="number">{slope(one.slope_percent, one.slope_sigma_percent)}</td>
              <td>{t(`segment.${statusOf(one)}`)}</td>
              <td class="number">{share(one.weight)}</td>
              <td>
                {one.method}
                {one.passes > 1 && ` · ${t("segment.passes", { n: one.passes })}`}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}

interface HistoryProps {
  segment: Segment;
  drives: Observation[];
  /** Whether these are all. */
  whole: boolean;
}

function History({ segment, drives, whole }: HistoryProps) {
  const { slope_percent: published, slope_sigma_percent: sigma } = segment.properties;
  const history = useMemo(() => together(drives), [drives]);
  const lines = useMemo(() => {
    const all: Line[] = [];
    const look = { unit: "%", decimals: Math.max(1, decimalsOf(sigma)) };
    if (published !== null)
      all.push({
        ...look,
        label: t("segment.line_published"),
        values: history.at.map(() => published),
        sigma: history.at.map(() => sigma),
        colour: "measured",
      });
    if (whole && history.at.length > 1)
      all.push({
        ...look,
        label: t("segment.line_mean"),
        values: history.mean,
        colour: "quiet",
        dashed: true,
      });
    all.push({
      ...look,
      label: t("segment.line_accepted"),
      values: history.accepted,
      sigma: history.sigma,
      colour: "other",
      points: true,
    });
    if (history.rejected.some((one) => one !== null))
      all.push({
        ...look,
        label: t("segment.line_rejected"),
        values: history.rejected,
        sigma: history.sigma,
        colour: "danger",
        points: true,
      });
    return all;
  }, [history, published, sigma, whole]);
  return (
    <>
      <Chart title={t("segment.history")} axis="moment" unit="%" x={history.at} lines={lines} height={180} />
      <p class="quiet-text small">{t("segment.history_note", { n: number(history.at.length) })}</p>
    </>
  );
}
