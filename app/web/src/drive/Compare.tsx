/** A drive beside another one, or beside a trial of itself: choosing, figures, and a table of segments. */
import { useSignal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { getJson, problemOf } from "../shared/api";
import { distance, moment, number, percent, slope } from "../shared/format";
import { tellError } from "../shared/Messages";
import { reasonOf } from "../shared/remarks";
import { t } from "../shared/texts";
import { agreementOf, alignedByRoad, alignedByTime, type Pair, pairsOf } from "./align";
import { addressOf, type Drive, type Trial } from "./data";
import { compareWith, driveId, lookAtTrials } from "./load";
import { Scrolled } from "./Scrolled";
import { segmentName, showSegment } from "./Segments";
import { stageOf } from "./Status";
import { other, profile, segments, trials, wanted } from "./state";

const STEP = 25;
const LISTED = 100;

/** Drives whose boxes overlap: those that may have roads in common. */
async function drivesNear(now: Drive): Promise<Drive[]> {
  const { drives } = await getJson<{ drives: Drive[] }>(`/v1/drives?status=done&limit=${LISTED}`);
  const [west, south, east, north] = now.bbox ?? [0, 0, 0, 0];
  return drives.filter((one) => {
    if (one.id === now.id || !one.bbox) return false;
    const [w, s, e, n] = one.bbox;
    return w <= east && e >= west && s <= north && n >= south;
  });
}

function Choice({ drive }: { drive: Drive }) {
  const near = useSignal<Drive[]>([]);
  useEffect(() => {
    drivesNear(drive).then((drives) => {
      near.value = drives;
    }, tellError);
  }, [drive.id]);
  const done = trials.value.filter((one) => one.status === "done");
  const asked = wanted.value;
  const now = asked ? `${asked.kind} ${asked.id}` : "";
  const strange = asked?.kind === "drive" && !near.value.some((one) => one.id === asked.id);
  return (
    <p class="drive-choice">
      <label for="compare-with">{t("drive.compare.with")}</label>
      <select
        id="compare-with"
        value={now}
        onChange={(event) => {
          const [kind, id] = event.currentTarget.value.split(" ");
          compareWith(kind ? (kind as "drive" | "trial") : null, id);
        }}
      >
        <option value="">{t("drive.compare.nothing")}</option>
        {done.length > 0 && (
          <optgroup label={t("drive.compare.trials")}>
            {done.map((one) => (
              <option key={one.id} value={`trial ${one.id}`}>
                {one.method}, {moment(one.created_at)}
              </option>
            ))}
          </optgroup>
        )}
        <optgroup label={t("drive.compare.drives")}>
          {strange && <option value={now}>{other.value?.name ?? asked.id}</option>}
          {near.value.map((one) => (
            <option key={one.id} value={`drive ${one.id}`}>
              {one.filename}, {moment(one.drive_time ?? one.created_at)}
            </option>
          ))}
        </optgroup>
      </select>
    </p>
  );
}

function TrialRow({ trial }: { trial: Trial }) {
  const drop = async () => {
    try {
      const response = await fetch(addressOf(driveId, `/trials/${trial.id}`), { method: "DELETE" });
      if (!response.ok) throw await problemOf(response);
      if (other.value?.id === trial.id) compareWith(null, "", true);
      await lookAtTrials();
    } catch (error) {
      tellError(error);
    }
  };
  const state =
    trial.status === "failed"
      ? trial.failure
        ? reasonOf(trial.failure)
        : ""
      : trial.status === "running"
        ? t("drive.status.at", { stage: stageOf(trial.stage), percent: Math.round(100 * trial.progress) })
        : t(trial.status === "done" ? "drive.trial.done" : "drive.status.queued");
  return (
    <li>
      <b>{trial.method}</b>{" "}
      <span class={trial.status === "failed" ? "error-text" : "quiet-text"}>{state}</span>{" "}
      {trial.status === "done" && other.value?.id !== trial.id && (
        <button type="button" class="quiet" onClick={() => compareWith("trial", trial.id)}>
          {t("drive.trial.compare", { method: trial.method })}
        </button>
      )}
      <button type="button" class="quiet" onClick={() => void drop()}>
        {t("drive.trial.drop", { method: trial.method })}
      </button>
    </li>
  );
}

function Trials() {
  if (trials.value.length === 0) return null;
  return (
    <>
      <h3>{t("drive.trial.title")}</h3>
      <p class="quiet-text">{t("drive.trial.what")}</p>
      <ul class="drive-trials" aria-live="polite">
        {trials.value.map((one) => (
          <TrialRow key={one.id} trial={one} />
        ))}
      </ul>
    </>
  );
}

function PairRow({ pair }: { pair: Pair }) {
  return (
    <tr>
      <th scope="row">
        <button type="button" class="quiet name" onClick={() => void showSegment(pair.segment)}>
          {segmentName(pair.segment)}
        </button>
      </th>
      <td class="number">{slope(...pair.first)}</td>
      <td class="number">{slope(...pair.other)}</td>
      <td class="number">{percent(pair.difference, 2)}</td>
      <td class={pair.sigmas > 3 ? "number warn-text" : "number"}>{number(pair.sigmas, 1)}</td>
    </tr>
  );
}

function Pairs({ pairs, name }: { pairs: Pair[]; name: string }) {
  const most = useSignal(STEP);
  const sorted = useMemo(() => [...pairs].sort((a, b) => (b.sigmas || 0) - (a.sigmas || 0)), [pairs]);
  return (
    <>
      <Scrolled name={t("drive.compare.table")}>
        <table>
          <caption class="unseen">{t("drive.compare.table")}</caption>
          <thead>
            <tr>
              <th scope="col">{t("drive.segments.road")}</th>
              <th scope="col" class="number">
                {t("drive.segments.this")}
              </th>
              <th scope="col" class="number">
                {name}
              </th>
              <th scope="col" class="number">
                {t("drive.compare.difference")}
              </th>
              <th scope="col" class="number">
                {t("drive.compare.sigmas")}
              </th>
            </tr>
          </thead>
          <tbody>
            {sorted.slice(0, most.value).map((pair) => (
              <PairRow key={pair.segment.id} pair={pair} />
            ))}
          </tbody>
        </table>
      </Scrolled>
      {sorted.length > most.value && (
        <button type="button" onClick={() => (most.value += 4 * STEP)}>
          {t("drive.compare.more", { n: sorted.length - most.value })}
        </button>
      )}
    </>
  );
}

function Beside() {
  const beside = other.value;
  const mine = profile.value;
  const pairs = useMemo(
    () => (beside ? pairsOf(segments.value, beside.segments) : []),
    [beside, segments.value],
  );
  if (!beside || !mine) return null;
  const agreement = agreementOf(pairs);
  const align = beside.kind === "trial" ? alignedByTime : alignedByRoad;
  const shared = align(mine, beside.profile).shared_m;
  return (
    <>
      <p role="status">
        {t(`drive.compare.axis_${beside.kind}`, { name: beside.name, length: distance(shared) })}
      </p>
      {agreement === null ? (
        <p>{t("drive.compare.no_common")}</p>
      ) : (
        <>
          <dl class="figures">
            <div>
              <dt>{t("drive.compare.segments")}</dt>
              <dd>{number(agreement.segments)}</dd>
            </div>
            <div>
              <dt>{t("drive.compare.median")}</dt>
              <dd>{percent(agreement.median, 2)}</dd>
            </div>
            <div>
              <dt>{t("drive.compare.rms")}</dt>
              <dd>{number(agreement.rms, 2)} %</dd>
            </div>
            <div>
              <dt>{t("drive.compare.within")}</dt>
              <dd>{number(100 * agreement.within)} %</dd>
            </div>
          </dl>
          <p class="quiet-text">{t(`drive.compare.honest_${beside.kind}`)}</p>
          <Pairs pairs={pairs} name={beside.name} />
        </>
      )}
      <p>
        {beside.kind === "drive" && (
          <a href={`/drives/${beside.id}`}>{t("drive.compare.open", { name: beside.name })}</a>
        )}{" "}
        <button type="button" onClick={() => compareWith(null)}>
          {t("drive.compare.stop")}
        </button>
      </p>
    </>
  );
}

export function Compare({ drive }: { drive: Drive }) {
  return (
    <section class="card" aria-labelledby="compare">
      <h2 id="compare">{t("drive.compare.title")}</h2>
      <Choice drive={drive} />
      <Beside />
      <Trials />
    </section>
  );
}
