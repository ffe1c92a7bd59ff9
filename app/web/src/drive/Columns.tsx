/** What the columns of a drive's CSV were taken as, to be corrected; and heights that are none above the sea. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { ColumnTable } from "../columns/ColumnTable";
import type { LogColumn, Named } from "../columns/corrected";
import { api, got } from "../shared/api";
import { number } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { methods } from "../shared/methods";
import { isNoLog } from "../shared/remarks";
import { t } from "../shared/texts";
import type { Drive } from "./data";
import { look } from "./load";

/** Formats that are tables; of one that failed nobody knows the format. */
const TABLES = ["csv", "torque"];

async function computeWith(drive: Drive, options: Record<string, unknown>): Promise<void> {
  const path = { drive_id: drive.id };
  const body = { options: { ...drive.options, ...options } };
  await got(api.POST("/v1/drives/{drive_id}/reprocess", { params: { path }, body }));
  tellDone(t("drive.again.asked"));
  await look();
}

const hasEnded = (drive: Drive) => drive.status === "done" || drive.status === "failed";

export function Columns({ drive }: { drive: Drive }) {
  const columns = useSignal<LogColumn[]>([]);
  const ours = useSignal<string[]>([]);
  const busy = useSignal(false);
  const had = (drive.options["columns"] ?? {}) as Named;
  const said = JSON.stringify(had);
  const may =
    drive.log_deleted_at === null &&
    hasEnded(drive) &&
    !isNoLog(drive) &&
    (drive.report === null || TABLES.includes(String(drive.report["format"])));
  useEffect(() => {
    if (!may) return;
    const path = { drive_id: drive.id };
    Promise.all([methods(), got(api.GET("/v1/drives/{drive_id}/columns", { params: { path } }))]).then(
      ([known, found]) => {
        ours.value = known.columns;
        columns.value = found.columns;
      },
      () => {
        columns.value = []; // the page says elsewhere what is wrong with the log
      },
    );
  }, [drive.id, may, said]);
  if (!may || columns.value.length === 0) return null;
  const guessed = columns.value.filter((one) => one.guessed).length;
  const use = async (named: Named) => {
    busy.value = true;
    await computeWith(drive, { columns: named }).catch(tellError);
    busy.value = false;
  };
  return (
    <details class="card drive-columns" open={drive.status === "failed"}>
      <summary>
        <h2>{t("columns.title")}</h2>
        {guessed > 0 && <span class="quiet-text">{t("columns.were_guessed", { n: guessed })}</span>}
      </summary>
      <p>{t("columns.how")}</p>
      <ColumnTable
        key={said}
        columns={columns.value}
        ours={ours.value}
        had={had}
        action={t("columns.again")}
        busy={busy.value}
        use={(named) => void use(named)}
      />
    </details>
  );
}

interface Doubt {
  above_model_m: number | null;
  above_sea_m: number | null;
  geoid: string | null;
  geoid_m: number | null;
  fits: boolean | null;
}

function odd(doubt: Doubt): string {
  const off = doubt.above_model_m ?? doubt.above_sea_m ?? 0;
  const by = number(Math.abs(off), 0);
  if (doubt.above_model_m === null) return t("heights.below_sea", { by });
  return t(off > 0 ? "heights.above_model" : "heights.below_model", { by });
}

function reason({ geoid_m: apart, fits }: Doubt): string {
  if (apart === null) return t("heights.perhaps");
  const by = number(Math.abs(apart), 0);
  if (fits) return t(apart > 0 ? "heights.sea_above" : "heights.sea_below", { by });
  return t("heights.no_fit", { by });
}

/** What is odd about its heights, unless they are taken otherwise already. */
export function doubtOf(drive: Drive): Doubt | null {
  if (drive.options["heights"] === "ellipsoid") return null;
  return (drive.report?.["height_doubt"] as Doubt | null | undefined) ?? null;
}

/** Heights that are probably above the ellipsoid, and a button that takes them so. */
export function Heights({ drive }: { drive: Drive }) {
  const busy = useSignal(false);
  const doubt = doubtOf(drive);
  if (!doubt) return null;
  const take = async () => {
    busy.value = true;
    await computeWith(drive, { heights: "ellipsoid" }).catch(tellError);
    busy.value = false;
  };
  return (
    <section class="card drive-heights" aria-labelledby="heights">
      <h2 id="heights">{t("heights.title")}</h2>
      <p>
        {odd(doubt)} {reason(doubt)}
      </p>
      {doubt.geoid_m === null && (
        <p>
          {t("heights.to_install")} <a href="/docs/how-to/import-roads-and-elevation">{t("heights.how")}</a>
        </p>
      )}
      {doubt.fits && drive.log_deleted_at === null && hasEnded(drive) && (
        <>
          <p>
            {doubt.geoid ? t("heights.by_geoid", { name: doubt.geoid }) : t("heights.by_log")}{" "}
            {t("heights.effect")}
          </p>
          <button type="button" class="primary" disabled={busy.value} onClick={() => void take()}>
            {t("heights.take")}
          </button>
        </>
      )}
    </section>
  );
}
