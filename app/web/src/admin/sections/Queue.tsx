/** What waits and runs now, and the batches that are under way. */
import { duration, moment, number } from "../../shared/format";
import { hasText, t } from "../../shared/texts";
import { batches, cancelBatch, forgetBatch } from "../actions/drives";
import { drivePage, drivesPage, mapOfBox, queryAddress } from "../links";
import { useQuery, useReading } from "../page_state";
import { Progress } from "../parts/Progress";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Batch, UnsolvedCell, Waiting } from "../types";

const CELLS = "cell to be solved";
const LISTS: Record<string, string> = {
  "drive, uploaded or asked for": drivesPage({ status: "queued" }),
  "drive, in a batch": drivesPage({ status: "queued" }),
  "drive, running": drivesPage({ status: "running" }),
  [CELLS]: "/v1/admin/stats",
};
const NAMES: Record<string, string> = {
  "drive, uploaded or asked for": "uploaded",
  "drive, in a batch": "in_batch",
  "drive, running": "running",
  [CELLS]: "cells",
};

function kindOf(row: Waiting): string {
  const key = `admin.queue.kinds.${NAMES[row.kind] ?? ""}`;
  return hasText(key) ? t(key) : row.kind;
}

export function Queue() {
  return (
    <>
      <Loaded of={useQuery<Waiting>("queue", 10)}>
        {({ rows }) => (
          <>
            <Table
              caption={t("admin.queue.caption")}
              none={t("admin.queue.none")}
              rows={rows}
              csv={queryAddress("queue")}
              columns={[
                { title: t("admin.queue.kind"), cell: kindOf },
                {
                  title: t("admin.queue.jobs"),
                  number: true,
                  cell: (row) => <a href={LISTS[row.kind] ?? queryAddress("queue")}>{number(row.jobs)}</a>,
                },
                { title: t("admin.queue.oldest"), number: true, cell: (row) => duration(row.oldest_s) },
              ]}
            />
            {rows.some((row) => row.kind === CELLS) && <Unsolved />}
          </>
        )}
      </Loaded>
      <UnderWay />
      {batches.value.map((one) => (
        <BatchCard key={one} batch={one} />
      ))}
    </>
  );
}

/** Cells that could not be solved after several attempts, if there are any. */
function Unsolved() {
  return (
    <Loaded of={useReading<{ unsolved: UnsolvedCell[] }>("/v1/admin/stats?days=1", 30)}>
      {({ unsolved }) =>
        unsolved.length === 0 ? null : (
          <Table
            caption={t("admin.queue.unsolved")}
            rows={unsolved}
            columns={[
              {
                title: t("admin.queue.cell"),
                cell: (row) => <a href={mapOfBox(row.bbox)}>{row.cell}</a>,
              },
              { title: t("admin.queue.solvers"), number: true, cell: (row) => number(row.solvers) },
              { title: t("admin.queue.since"), cell: (row) => moment(row.since) },
              { title: t("admin.queue.next"), cell: (row) => moment(row.next_at) },
              {
                title: t("admin.queue.concerned"),
                cell: (row) => (
                  <>
                    {row.drives.map((id) => (
                      <a key={id} href={drivePage(id)}>
                        {id.slice(0, 8)}{" "}
                      </a>
                    ))}
                    <span class="reason">{t("admin.queue.advice", { n: row.solvers - 1 })}</span>
                  </>
                ),
              },
            ]}
          />
        )
      }
    </Loaded>
  );
}

function Figures({ seen, batch }: { seen: Batch; batch: number | null }) {
  const of = (status: string) => drivesPage({ status, batch });
  return (
    <dl class="figures">
      {(["queued", "running", "done", "failed"] as const).map((status) => (
        <div key={status}>
          <dt>{t(`admin.status.${status}`)}</dt>
          <dd>
            <a href={of(status)}>{number(seen[status])}</a>
          </dd>
        </div>
      ))}
    </dl>
  );
}

/** All drives that wait or run, whoever asked for them. */
function UnderWay() {
  return (
    <Loaded of={useReading<Batch>("/v1/drives/reprocess", 10)}>
      {(seen) =>
        seen.queued + seen.running === 0 ? null : (
          <div class="card">
            <h3>{t("admin.queue.under_way")}</h3>
            <Progress share={seen.progress} label={t("admin.queue.under_way")} />
            <Figures seen={seen} batch={null} />
          </div>
        )
      }
    </Loaded>
  );
}

/** One batch that was asked for on this page. */
function BatchCard({ batch }: { batch: number }) {
  const reading = useReading<Batch>(`/v1/drives/reprocess?batch=${batch}`, 3);
  return (
    <Loaded of={reading}>
      {(seen) => {
        const active = seen.state === "enqueuing" || seen.state === "running";
        return (
          <section class="card" aria-label={t("admin.batch.title", { batch })}>
            <h3>
              {t("admin.batch.title", { batch })} – {t(`admin.batch.states.${seen.state}`)}
            </h3>
            <p class="quiet-text">{t("admin.batch.asked", { at: moment(seen.asked_at) })}</p>
            <Progress share={seen.progress} label={t("admin.batch.title", { batch })} />
            <Figures seen={seen} batch={batch} />
            <div class="buttons">
              <a class="button" href={drivesPage({ batch })}>
                {t("admin.batch.list")}
              </a>
              {active ? (
                <button type="button" class="danger" onClick={() => void cancelBatch(batch, seen.queued)}>
                  {t("admin.batch.cancel")}
                </button>
              ) : (
                <button type="button" onClick={() => forgetBatch(batch)}>
                  {t("admin.batch.hide")}
                </button>
              )}
            </div>
          </section>
        );
      }}
    </Loaded>
  );
}
