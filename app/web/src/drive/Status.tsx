/** Where a drive is that has not ended well yet: its progress, why it failed, that it is gone. */
import { stageText } from "../shared/drives";
import { duration } from "../shared/format";
import { failureText, isNoLog, reasonOf, whereOf } from "../shared/remarks";
import { hasText, t } from "../shared/texts";
import { WaitsForRoads } from "../shared/Waits";
import { RetryButton } from "./Actions";
import { addressOf, type Drive, isComputed } from "./data";

/** What the worker is, or was, doing: parts of a run besides the stages that the list of uploads knows. */
export function stageOf(stage: string | null): string {
  const key = `drive.status.${stage}`;
  return hasText(key) ? t(key) : stageText(stage);
}

export function Waiting({ drive }: { drive: Drive }) {
  const percent = Math.round(100 * drive.progress);
  const shown = drive.report === null ? "live" : isComputed(drive) ? "computed" : "old_shown";
  return (
    <section class="card drive-status" aria-labelledby="status">
      <h2 id="status">{t(`drive.status.${drive.status === "running" ? "running" : "queued"}`)}</h2>
      <progress max={100} value={percent} aria-labelledby="status" />
      <p role="status">
        {drive.status === "queued"
          ? t("drive.status.waits")
          : t("drive.status.at", { stage: stageOf(drive.stage), percent })}
      </p>
      {drive.remaining_s !== null && (
        <p class="quiet-text">{t("drive.status.left", { time: duration(drive.remaining_s) })}</p>
      )}
      <p class="quiet-text">{t(`drive.status.${shown}`)}</p>
    </section>
  );
}

/** No roads are where it was driven: what would help. What the log says is shown below. */
export function WaitsHere({ drive }: { drive: Drive }) {
  return (
    <section class="card drive-status" aria-labelledby="waits">
      <h2 id="waits">{t("roads.waits")}</h2>
      <WaitsForRoads drive={drive} />
      <p class="quiet-text">{t("roads.elsewhere")}</p>
    </section>
  );
}

export function Failed({ drive }: { drive: Drive }) {
  const failure = drive.failure;
  if (!failure) return null;
  return (
    <section class="card drive-status failed" aria-labelledby="failed">
      <h2 id="failed" class="error-text">
        {t("drive.failed.title")}
      </h2>
      <p>{reasonOf(failure)}</p>
      <dl class="figures">
        <div>
          <dt>{t("drive.failed.stage")}</dt>
          <dd>{stageOf(failure.stage)}</dd>
        </div>
        {failure.where && (
          <div>
            <dt>{t("drive.failed.where")}</dt>
            <dd>{whereOf(failure)}</dd>
          </div>
        )}
        <div>
          <dt>{t("drive.failed.kind")}</dt>
          <dd>{failureText(failure.kind)}</dd>
        </div>
      </dl>
      {drive.log_deleted_at === null && (
        <p class="quiet-text">{t(isNoLog(drive) ? "drive.failed.no_log" : "drive.failed.advice")}</p>
      )}
      <div class="buttons start">
        {drive.log_deleted_at === null && (
          <>
            {!isNoLog(drive) && <RetryButton />}
            <a class="button" href={addressOf(drive.id, "/log")} download={drive.filename}>
              {t("drive.download.log")}
            </a>
          </>
        )}
        <a class="button" href="/upload">
          {t("drive.failed.upload")}
        </a>
      </div>
    </section>
  );
}

/** There is no such drive, or no more. */
export function Nothing({ gone }: { gone: boolean }) {
  return (
    <section class="card drive-status" aria-labelledby="nothing">
      <h1 id="nothing">{t(gone ? "drive.gone.title" : "drive.none.title")}</h1>
      <p role="status">{t(gone ? "drive.gone.what" : "drive.none.what")}</p>
      <div class="buttons start">
        <a class="button primary" href="/drives">
          {t("drive.to_list")}
        </a>
        <a class="button" href="/upload">
          {t("drive.to_upload")}
        </a>
      </div>
    </section>
  );
}
