/** One drive: where it went, what it measured, what became of it, and how it compares. */
import { useEffect, useMemo } from "preact/hooks";
import { ApiProblem } from "../shared/api";
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { waitsForRoads } from "../shared/Waits";
import { Actions } from "./Actions";
import { Charts } from "./Charts";
import { Climbs, RideFigures } from "./Climbs";
import { Columns, Heights } from "./Columns";
import { Compare } from "./Compare";
import type { Drive, Profile } from "./data";
import { look, open } from "./load";
import { Contradictions } from "./Segments";
import { Failed, Nothing, Waiting, WaitsHere } from "./Status";
import { Downloads, Figures, LogFigures, Remarks, ReportCard } from "./Summary";
import {
  drive,
  fullKinds,
  fullProfile,
  hasResult,
  kinds,
  link,
  other,
  problem,
  profile,
  removed,
} from "./state";
import { TrackMap } from "./TrackMap";
import { KINDS } from "./trackLayers";
import "./drive.css";

function Track({ profile: thinned }: { profile: Profile }) {
  const shown = fullProfile.value ?? thinned;
  const what = fullProfile.value ? fullKinds.value : kinds.value;
  const beside = other.value?.profile ?? null;
  const map = useMemo(
    () => <TrackMap profile={shown} kinds={what} other={beside} link={link} />,
    [shown, what, beside],
  );
  return (
    <section class="drive-map" aria-labelledby="track">
      <h2 id="track" class="unseen">
        {t("drive.map.title")}
      </h2>
      {map}
      {hasResult.value && (
        <ul class="track-legend">
          {KINDS.map((kind) => (
            <li key={kind}>
              <span class={`track-key ${kind}`} />
              {t(`drive.map.${kind}`)}
            </li>
          ))}
          {beside && (
            <li>
              <span class="track-key other" />
              {other.value?.name}
            </li>
          )}
        </ul>
      )}
    </section>
  );
}

function Shown({ drive: now }: { drive: Drive }) {
  const rows = profile.value;
  const waits = waitsForRoads(now);
  return (
    <>
      <p class="drive-back">
        <a href="/drives">{t("drive.to_list")}</a>
      </p>
      <h1 class="drive-name">{now.filename}</h1>
      {waits && <WaitsHere drive={now} />}
      {now.status === "failed" && !waits && <Failed drive={now} />}
      {(now.status === "queued" || now.status === "running") && <Waiting drive={now} />}
      {now.report === null && rows && (
        <>
          <RideFigures />
          <div class="drive-top">
            <Track profile={rows} />
            <div class="drive-side">
              <Climbs />
              <section class="card" aria-labelledby="figures">
                <h2 id="figures">{t("drive.figure.title")}</h2>
                <LogFigures drive={now} />
              </section>
              <Downloads drive={now} />
            </div>
          </div>
          <Charts profile={rows} />
        </>
      )}
      {now.report !== null && (
        <>
          <RideFigures />
          <div class="drive-top">
            {rows ? <Track profile={rows} /> : <div class="drive-map" />}
            <div class="drive-side">
              <Remarks drive={now} />
              <Heights drive={now} />
              <Climbs />
              <section class="card" aria-labelledby="figures">
                <h2 id="figures">{t("drive.figure.title")}</h2>
                <Figures drive={now} />
              </section>
              <Downloads drive={now} />
            </div>
          </div>
          {rows && <Charts profile={rows} />}
          {now.status === "done" && <Compare drive={now} />}
          <Contradictions />
          <ReportCard drive={now} />
        </>
      )}
      <Columns drive={now} />
      <Actions drive={now} />
    </>
  );
}

function Body() {
  const now = drive.value;
  const wrong = problem.value;
  if (removed.value || now?.status === "cancelled") return <Nothing gone />;
  if (now) return <Shown drive={now} />;
  if (wrong === null) return <p class="quiet-text">{t("drive.loading")}</p>;
  // A name that is no id at all is answered 422.
  if (wrong instanceof ApiProblem && (wrong.status === 404 || wrong.status === 422))
    return <Nothing gone={false} />;
  return (
    <section class="card drive-status">
      <h1>{t("drive.unreadable")}</h1>
      <p class="error-text" role="alert">
        {errorText(wrong)}
      </p>
      <button type="button" onClick={() => void look()}>
        {t("drive.try_again")}
      </button>
    </section>
  );
}

function Content() {
  useEffect(() => void open(), []);
  return (
    <Page name="drives">
      <Body />
    </Page>
  );
}

await show("drives", Content);
drive.subscribe((now) => {
  if (now) document.title = `${now.filename} – Versant`;
});
