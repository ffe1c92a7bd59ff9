/** The owner's zones, as a list of fields. */
import { tellDone } from "../shared/Messages";
import { useSending } from "../shared/sending";
import { t } from "../shared/texts";
import { newZone, saveZones, type Zone, zones } from "./state";

const MOST = 50;
const FIELDS = [
  ["lat", "owner.lat", { min: -90, max: 90, step: "any" }],
  ["lon", "owner.lon", { min: -180, max: 180, step: "any" }],
  ["radius", "owner.radius", { min: 50, max: 5000, step: 1 }],
] as const;

function change(zone: Zone, part: Partial<Zone>): void {
  zones.value = (zones.value ?? []).map((one) => (one.key === zone.key ? { ...one, ...part } : one));
}

function Row({ of: zone, n }: { of: Zone; n: number }) {
  return (
    <fieldset class="zone">
      <legend>{t("owner.zone", { n })}</legend>
      <label class="field">
        <span>{t("owner.zone_name")}</span>
        <input
          value={zone.name}
          required
          maxLength={100}
          onInput={(event) => change(zone, { name: event.currentTarget.value })}
        />
      </label>
      {FIELDS.map(([field, title, range]) => (
        <label key={field} class="field">
          <span>{t(title)}</span>
          <input
            type="number"
            required
            {...range}
            value={zone[field]}
            onInput={(event) => change(zone, { [field]: event.currentTarget.value })}
          />
        </label>
      ))}
      <button
        type="button"
        aria-label={t("owner.drop_zone", { name: zone.name || String(n) })}
        onClick={() => {
          zones.value = (zones.value ?? []).filter((one) => one.key !== zone.key);
        }}
      >
        {t("owner.drop")}
      </button>
    </fieldset>
  );
}

export function Zones() {
  const { busy, submit, failure } = useSending(async () => {
    await saveZones();
    tellDone(t("owner.saved"));
  });
  const all = zones.value;
  if (all === null) return null;
  return (
    <form class="card zones" aria-labelledby="zones" onSubmit={submit}>
      <h2 id="zones">{t("owner.zones")}</h2>
      <p>{t("owner.zones_what")}</p>
      {all.length === 0 && <p class="quiet-text">{t("owner.zones_none")}</p>}
      {all.map((zone, index) => (
        <Row key={zone.key} of={zone} n={index + 1} />
      ))}
      {failure}
      <div class="tools">
        <button
          type="button"
          disabled={all.length >= MOST}
          onClick={() => {
            zones.value = [...all, newZone()];
          }}
        >
          {t("owner.add_zone")}
        </button>
        <button type="submit" class="primary" disabled={busy}>
          {t("owner.save_zones")}
        </button>
      </div>
    </form>
  );
}
