/** Whether drives agree: the worst disagreements, and how sure slopes are by number of drives. */
import { number, percent, slope } from "../../shared/format";
import { t } from "../../shared/texts";
import { mapOfSegment, queryAddress } from "../links";
import { useQuery } from "../page_state";
import { HeatTable } from "../parts/HeatTable";
import { AsOf, Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Disagreement, SigmaCount } from "../types";

function Disagreements() {
  return (
    <Loaded of={useQuery<Disagreement>("disagreements", 60)}>
      {(answer) => (
        <>
          <Table
            caption={t("admin.agreement.caption")}
            none={t("admin.agreement.none")}
            rows={answer.rows}
            csv={queryAddress("disagreements")}
            columns={[
              {
                title: t("admin.agreement.segment"),
                cell: (row) => (
                  <a href={mapOfSegment(row.segment_id)}>{row.name ?? `${row.highway} ${row.segment_id}`}</a>
                ),
              },
              {
                title: t("admin.agreement.slope"),
                number: true,
                cell: (row) => slope(row.slope_percent, row.slope_sigma_percent),
              },
              {
                title: t("admin.agreement.range"),
                number: true,
                cell: (row) =>
                  t("admin.agreement.from_to", {
                    from: percent(row.lowest_percent),
                    to: percent(row.highest_percent),
                  }),
              },
              {
                title: t("admin.agreement.farthest"),
                number: true,
                cell: (row) => (row.farthest_sigmas === null ? "–" : `${number(row.farthest_sigmas, 1)} σ`),
              },
              {
                title: t("admin.agreement.drives"),
                number: true,
                cell: (row) => (
                  <a href={`/v1/segments/${row.segment_id}/observations`}>
                    {t("admin.agreement.rejected", { n: row.drives_rejected, accepted: row.drives })}
                  </a>
                ),
              },
            ]}
          />
          <AsOf answer={answer} />
        </>
      )}
    </Loaded>
  );
}

export function Agreement() {
  return (
    <>
      <p>{t("admin.agreement.what")}</p>
      <Disagreements />
      <Loaded of={useQuery<SigmaCount>("sigmas", 60)}>
        {(answer) =>
          answer.rows.length === 0 ? null : (
            <>
              <HeatTable rows={answer.rows} />
              <AsOf answer={answer} />
            </>
          )
        }
      </Loaded>
    </>
  );
}
