/** Who asked for what that cannot be undone, the latest first. */
import { moment } from "../../shared/format";
import { t } from "../../shared/texts";
import { queryAddress } from "../links";
import { days, useQuery } from "../page_state";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Audited } from "../types";

function detailText(detail: Audited["detail"] | string): string {
  if (detail === null) return "–";
  if (typeof detail === "string") return detail;
  return (
    Object.entries(detail)
      .filter(([, value]) => value !== null && typeof value !== "object")
      .map(([name, value]) => `${name}: ${String(value)}`)
      .join(", ") || "–"
  );
}

export function Audit() {
  return (
    <Loaded of={useQuery<Audited>("audit", 30, days.value)}>
      {({ rows }) => (
        <Table
          caption={t("admin.audit.caption")}
          none={t("admin.audit.none")}
          rows={rows}
          csv={queryAddress("audit", { days: days.value, f: "csv" })}
          columns={[
            { title: t("admin.audit.at"), cell: (row) => moment(row.at) },
            { title: t("admin.audit.action"), cell: (row) => row.action },
            { title: t("admin.audit.subject"), cell: (row) => row.subject ?? "–" },
            { title: t("admin.audit.detail"), cell: (row) => detailText(row.detail) },
            { title: t("admin.audit.origin"), cell: (row) => row.origin ?? "–" },
          ]}
        />
      )}
    </Loaded>
  );
}
