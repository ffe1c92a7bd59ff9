/** What segments and ways have in common: the road's name and class above, where to read on below. */
import { copy } from "../shared/clipboard";
import { distance } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import type { Position } from "./data";
import { kinds, roadClass } from "./words";

interface RoadProps {
  title: string;
  road: {
    name: string | null;
    highway: string;
    length_m: number;
    bridge: boolean;
    tunnel: boolean;
    oneway: number;
  };
}

export function Road({ title, road }: RoadProps) {
  return (
    <header class="road">
      <h2>{road.name ?? t("segment.unnamed")}</h2>
      <p class="quiet-text">
        {[title, roadClass(road.highway), distance(road.length_m), ...kinds(road)].join(" · ")}
      </p>
    </header>
  );
}

interface SourcesProps {
  osmWay: number;
  place: Position;
  address: string;
  /** What the button copies. */
  copied: unknown;
}

export function Sources({ osmWay, place, address, copied }: SourcesProps) {
  const osm = "https://www.openstreetmap.org";
  const away = { target: "_blank", rel: "noreferrer" };
  const at = `${place[1].toFixed(6)}/${place[0].toFixed(6)}`;
  const press = () =>
    copy(JSON.stringify(copied, null, 2), t("segment.copy_refused")).then(
      () => tellDone(t("segment.copied")),
      (error) => tellError(error instanceof Error ? error.message : error),
    );
  return (
    <>
      <h3>{t("segment.elsewhere")}</h3>
      <ul class="sources">
        <li>
          <a href={`${osm}/way/${osmWay}`} {...away}>
            {t("segment.osm_way", { id: String(osmWay) })}
          </a>
        </li>
        <li>
          <a href={`${osm}/?mlat=${place[1].toFixed(6)}&mlon=${place[0].toFixed(6)}#map=18/${at}`} {...away}>
            {t("segment.osm_place")}
          </a>
        </li>
        <li>
          <a href={address}>{t("segment.in_api")}</a>
        </li>
        <li>
          <button type="button" onClick={press}>
            {t("segment.copy")}
          </button>
        </li>
      </ul>
    </>
  );
}
