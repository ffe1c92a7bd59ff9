/** The part of the map that is shown as a file, with the filters of the page. */
import { t } from "../../shared/texts";
import { classes, layer, leastDrives, mostSigma } from "../state";
import { Making, mayMake, OnlyWithKey, useMaking } from "./making";

const FORMATS = {
  segments: ["gpkg", "geojson", "csv", "geoparquet"],
  ways: ["ways-csv", "ways-parquet"],
} as const;

export default function ExportView() {
  const { make, ...making } = useMaking();
  if (!mayMake()) return <OnlyWithKey />;
  const narrowed = mostSigma.value !== null || leastDrives.value > 0;
  const ask = (format: string) =>
    make({
      format,
      most_sigma_percent: mostSigma.value,
      least_drives: leastDrives.value,
      driven: narrowed,
    });
  return (
    <>
      <p>{t(`tools.export.how_${layer.value}`)}</p>
      {narrowed && <p class="quiet-text small">{t("tools.export.narrowed")}</p>}
      {classes.value.length > 0 && <p class="note">{t("tools.export.not_classes")}</p>}
      <ul class="formats">
        {FORMATS[layer.value].map((one) => (
          <li key={one}>
            <button type="button" disabled={making.busy} onClick={() => ask(one)}>
              {t(`tools.export.format.${one}`)}
            </button>
            <span class="quiet-text">{t(`tools.export.for.${one}`)}</span>
          </li>
        ))}
      </ul>
      <Making {...making} nothing={t("tools.export.nothing")} />
      <p class="quiet-text small">
        <a href="/docs/how-to/export-files">{t("tools.export.more")}</a>
      </p>
    </>
  );
}
