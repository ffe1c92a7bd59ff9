/** What takes room, the kept tiles, and which versions of everything there are. */
import { number, size } from "../../shared/format";
import { hasText, t } from "../../shared/texts";
import { drivesPage, queryAddress } from "../links";
import { offers, useQuery } from "../page_state";
import { AsOf, Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Stored, Tiles } from "../types";

function Storage() {
  return (
    <Loaded of={useQuery<Stored>("storage", 60)}>
      {({ rows }) => (
        <Table
          caption={t("admin.storage.caption")}
          rows={rows}
          csv={queryAddress("storage")}
          most={10}
          columns={[
            {
              title: t("admin.storage.name"),
              cell: (row) =>
                row.kind === "logs" ? (
                  <a href={drivesPage()}>{t("admin.storage.logs")}</a>
                ) : (
                  <span lang="en">{row.name}</span>
                ),
            },
            { title: t("admin.storage.rows"), number: true, cell: (row) => number(row.rows_about) },
            { title: t("admin.storage.table"), number: true, cell: (row) => size(row.table_bytes) },
            { title: t("admin.storage.index"), number: true, cell: (row) => size(row.index_bytes) },
          ]}
        />
      )}
    </Loaded>
  );
}

function KeptTiles() {
  return (
    <Loaded of={useQuery<Tiles>("tiles", 60)}>
      {(answer) => (
        <>
          <Table
            caption={t("admin.tiles.caption")}
            none={t("admin.tiles.none")}
            rows={answer.rows}
            csv={queryAddress("tiles")}
            most={25}
            columns={[
              { title: t("admin.tiles.zoom"), number: true, cell: (row) => number(row.zoom) },
              { title: t("admin.tiles.tiles"), number: true, cell: (row) => number(row.tiles) },
              { title: t("admin.tiles.bytes"), number: true, cell: (row) => size(row.bytes) },
              { title: t("admin.tiles.stale"), number: true, cell: (row) => number(row.stale) },
            ]}
          />
          <AsOf answer={answer} />
        </>
      )}
    </Loaded>
  );
}

interface Version {
  what: string;
  version: string | null;
  detail: string | null;
}

function versionName({ what }: Version): string {
  const key = `admin.versions.names.${what}`;
  return hasText(key) ? t(key) : what;
}

function Versions() {
  return (
    <Loaded of={useQuery<Version>("versions", 60)}>
      {({ rows }) => (
        <Table
          caption={t("admin.versions.caption")}
          rows={rows}
          csv={queryAddress("versions")}
          most={25}
          columns={[
            { title: t("admin.versions.what"), cell: versionName },
            { title: t("admin.versions.version"), cell: (row) => row.version ?? "–" },
            { title: t("admin.versions.detail"), cell: (row) => row.detail ?? "–" },
          ]}
        />
      )}
    </Loaded>
  );
}

export function Room() {
  return (
    <>
      {offers("storage") && <Storage />}
      {offers("tiles") && <KeptTiles />}
      {offers("versions") && <Versions />}
    </>
  );
}
