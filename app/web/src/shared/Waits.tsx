/** What a drive waits for that no worker can give it, and what would help. */
import type { Drive } from "./drives";
import { RoadsAdvice } from "./roads";
import { t } from "./texts";

type Waiting = Pick<Drive, "waits_for"> & { bbox: readonly number[] | null };

/** Whether it waits for roads: for the service it failed, for people it did not. */
export function waitsForRoads(drive: { waits_for?: Drive["waits_for"] } | null): boolean {
  return drive?.waits_for?.kind === "roads";
}

/** Where an extract of that name is offered. */
function Offered({ name }: { name: string }) {
  return (
    <a href={`https://download.geofabrik.de/${name}.html`} rel="noreferrer">
      {name}
    </a>
  );
}

/** The extract that would help, and how it gets there. */
export function WaitsForRoads({ drive }: { drive: Waiting }) {
  const [first, ...others] = drive.waits_for?.extracts ?? [];
  const [west = 0, south = 0, east = 0, north = 0] = drive.bbox ?? [];
  const degrees = (value: number) => value.toLocaleString(undefined, { maximumFractionDigits: 1 });
  return (
    <p class="waits-for">
      {t("roads.none_there")}{" "}
      {first === undefined ? (
        t("roads.covering", {
          south: degrees(south),
          north: degrees(north),
          west: degrees(west),
          east: degrees(east),
        })
      ) : (
        <>
          {t("roads.helps")} <Offered name={first} />
          {others.map((name) => (
            <span key={name}>
              {" "}
              {t("roads.or")} <Offered name={name} />
            </span>
          ))}
          .
        </>
      )}{" "}
      {t("roads.by_itself")} <RoadsAdvice />
    </p>
  );
}
