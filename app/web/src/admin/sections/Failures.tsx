/** Why drives failed, with retry and removal of all that failed so. */
import { useState } from "preact/hooks";
import { moment, number } from "../../shared/format";
import { failureText } from "../../shared/remarks";
import { inWords } from "../../shared/said";
import { t } from "../../shared/texts";
import { remove, reprocess } from "../actions/drives";
import { drivePage, drivesPage, firstMoment, queryAddress } from "../links";
import { days, useQuery } from "../page_state";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Failure } from "../types";

function listOf(row: Failure): string {
  return drivesPage({
    status: "failed",
    failure: row.kind,
    created_after: firstMoment(days.value),
    waits_for: row.waiting ? "nothing" : null,
  });
}

/** Drives that wait for roads are told in a place of their own. */
function withoutWaiting(row: Failure): Failure {
  const waiting = row.waiting ?? 0;
  const share = row.share === null ? null : (row.share * (row.drives - waiting)) / Math.max(row.drives, 1);
  return { ...row, share, drives: row.drives - waiting };
}

export function Failures() {
  const [message, setMessage] = useState<string | null>(null);
  const reading = useQuery<Failure>("failures", 30, days.value);
  const acts = (row: Failure) => {
    if (row.kind === null) return null;
    const kind = failureText(row.kind);
    const whom = t("admin.failures.whom", { kind, n: days.value });
    const selection = { which: "failed", failure: row.kind, created_after: firstMoment(days.value) };
    return (
      <span class="acts">
        <button
          type="button"
          aria-label={t("admin.failures.retry_of", { kind })}
          onClick={() => void reprocess(selection, whom).then(setMessage)}
        >
          {t("admin.failures.retry")}
        </button>
        <button
          type="button"
          class="danger"
          aria-label={t("admin.failures.remove_of", { kind })}
          onClick={() => void remove(selection, whom).then(setMessage)}
        >
          {t("admin.failures.remove")}
        </button>
      </span>
    );
  };
  return (
    <Loaded of={reading}>
      {({ rows: all }) => {
        const rows = all.map(withoutWaiting).filter((row) => row.drives > 0);
        return (
          <>
            {rows.length > 0 && <p>{t("admin.failures.what", { n: days.value })}</p>}
            {message && <p role="status">{message}</p>}
            <Table
              caption={t("admin.failures.caption")}
              none={t("admin.failures.none")}
              rows={rows}
              csv={queryAddress("failures", { days: days.value, f: "csv" })}
              columns={[
                { title: t("admin.failures.kind"), cell: (row) => failureText(row.kind ?? "unknown") },
                {
                  title: t("admin.failures.drives"),
                  number: true,
                  cell: (row) => <a href={listOf(row)}>{number(row.drives)}</a>,
                },
                { title: t("admin.failures.acts"), cell: acts },
                {
                  title: t("admin.failures.share"),
                  number: true,
                  cell: (row) => (row.share === null ? "–" : `${number(100 * row.share, 1)} %`),
                },
                {
                  title: t("admin.failures.latest"),
                  cell: (row) => (
                    <>
                      {row.latest_drive ? (
                        <a href={drivePage(row.latest_drive)}>{moment(row.latest_at)}</a>
                      ) : (
                        moment(row.latest_at)
                      )}
                      <br />
                      <span class="reason">{inWords(row.latest_reason ?? "", row.latest_said)}</span>
                    </>
                  ),
                },
              ]}
            />
          </>
        );
      }}
    </Loaded>
  );
}
