/** The legend: what colours stand for, buttons that filter, sliders, and how much of what is in view is shown. */
import { useState } from "preact/hooks";
import { config } from "../shared/config";
import { number } from "../shared/format";
import { type TextKey, t } from "../shared/texts";
import { KeptMaps } from "./KeptMaps";
import { counts, kept, legend, segmentsFrom } from "./shown";
import {
  background,
  type Class,
  COLOURS,
  type Colour,
  classes,
  colour,
  flyTo,
  type LayerName,
  layer,
  leastDrives,
  mostSigma,
  ofSegmentsOnly,
  view,
} from "./state";
import { filters, type LegendClass } from "./style";
import { LEAST_ZOOM } from "./tiles";

const SIGMAS = [0.1, 0.2, 0.3, 0.5, 0.75, 1, 1.5, 2, 3, 5] as const;
const DRIVES = [0, 1, 2, 3, 5, 10, 20, 50, 100] as const;

function toggle(one: Class): void {
  const now = classes.value;
  const order = (k: Class) => (k === "unknown" ? -1 : k);
  classes.value = now.includes(one)
    ? now.filter((other) => other !== one)
    : [...now, one].sort((a, b) => order(a) - order(b));
}

function nameOf({ from_percent, to_percent }: LegendClass): string {
  const digits = Number.isInteger(from_percent) && Number.isInteger(to_percent ?? 0) ? 0 : 1;
  const from = number(from_percent, digits);
  return to_percent === null
    ? t("map.class_last", { from })
    : t("map.class", { from, to: number(to_percent, digits) });
}

function ClassButton({ one, name, shade }: { one: Class; name: string; shade: string }) {
  const count = one === "unknown" ? counts.value?.unknown : counts.value?.each[one];
  return (
    <li>
      <button type="button" aria-pressed={classes.value.includes(one)} onClick={() => toggle(one)}>
        <span class={one === "unknown" ? "swatch thin" : "swatch"} style={{ background: shade }} />
        <span class="name">{name}</span>
        <span class="count">
          {number(count)}
          <span class="unseen"> {t("map.in_view")}</span>
        </span>
      </button>
    </li>
  );
}

function Slider(props: {
  name: string;
  steps: readonly (number | null)[];
  value: number | null;
  describe: (value: number | null) => string;
  choose: (value: number | null) => void;
  disabled: boolean;
}) {
  const { steps, value } = props;
  const chosen = steps.indexOf(value);
  const at =
    chosen >= 0 ? chosen : steps.findIndex((one) => one === null || (value !== null && one >= value));
  const [moving, setMoving] = useState<number | null>(null);
  const shown = moving ?? at;
  return (
    <label class="slider">
      <span>{props.name}</span>
      <span aria-hidden="true">{props.describe(moving === null ? value : (steps[moving] ?? null))}</span>
      <input
        type="range"
        min={0}
        max={steps.length - 1}
        step={1}
        value={shown}
        disabled={props.disabled}
        aria-valuetext={props.describe(steps[shown] ?? null)}
        onInput={(event) => setMoving(Number(event.currentTarget.value))}
        onChange={(event) => {
          setMoving(null);
          props.choose(steps[Number(event.currentTarget.value)] ?? null);
        }}
      />
    </label>
  );
}

function Choices() {
  const choose = (wanted: LayerName) => {
    if (wanted === "ways" && ofSegmentsOnly(colour.value)) colour.value = "steepness";
    classes.value = [];
    layer.value = wanted;
  };
  return (
    <>
      <label class="choice">
        <span>{t("map.colours_show")}</span>
        <select
          value={colour.value}
          onChange={(event) => {
            classes.value = [];
            colour.value = event.currentTarget.value as Colour;
          }}
        >
          {COLOURS.map((one) => (
            <option key={one} value={one} disabled={layer.value === "ways" && ofSegmentsOnly(one)}>
              {t(`map.colour.${one}` as TextKey)}
            </option>
          ))}
        </select>
      </label>
      <fieldset class="choice">
        <legend>{t("map.drawn")}</legend>
        {(["segments", "ways"] as const).map((one) => (
          <label key={one}>
            <input
              type="radio"
              name="layer"
              checked={layer.value === one}
              disabled={one === "ways" && kept.value !== null}
              onChange={() => choose(one)}
            />{" "}
            {t(`map.layer.${one}`)}
          </label>
        ))}
      </fieldset>
      <Backgrounds />
      <KeptMaps />
    </>
  );
}

/** A choice where the operator offers one. */
function Backgrounds() {
  const names = Object.keys(config.backgrounds);
  if (!names.length) return null;
  return (
    <label class="choice">
      <span>{t("map.background")}</span>
      <select
        value={background.value ?? ""}
        onChange={(event) => {
          background.value = event.currentTarget.value || null;
        }}
      >
        <option value="">
          {t(config.background_style_url ? "map.background_usual" : "map.background_none")}
        </option>
        {names.map((one) => (
          <option key={one} value={one}>
            {one}
          </option>
        ))}
      </select>
    </label>
  );
}

function Hint() {
  const zoom = view.value?.zoom ?? 20;
  const modelled = ofSegmentsOnly(colour.value);
  const least = layer.value === "segments" && modelled ? segmentsFrom.value : LEAST_ZOOM[layer.value];
  if (zoom < least)
    return (
      <p class="hint" role="status">
        {t(layer.value === "ways" ? "map.ways_nearer" : modelled ? "map.model_nearer" : "map.roads_nearer")}{" "}
        <button type="button" onClick={() => view.value && flyTo({ ...view.value, zoom: least + 0.2 })}>
          {t("map.zoom_there")}
        </button>
      </p>
    );
  const counted = counts.value;
  if (counted && counted.all > 0 && counted.measured === 0 && colour.value !== "elevation-model")
    return (
      <p class="hint">
        {t("map.none_measured")} <a href="/upload">{t("map.upload")}</a>
      </p>
    );
  return null;
}

function Count() {
  const counted = counts.value;
  if (!counted) return null;
  const kind =
    layer.value === "ways"
      ? "ways"
      : (view.value?.zoom ?? 20) < segmentsFrom.value
        ? "stretches"
        : "segments";
  const shown = number(counted.shown);
  return (
    <p class="total" role="status">
      {t(`map.of_${kind}`, { n: counted.all, shown })}
    </p>
  );
}

/** The legend with everything that chooses what is shown. */
export function Legend() {
  const shades = legend.value;
  const [narrow] = useState(() => matchMedia("(max-width: 40rem), (max-height: 30rem)").matches);
  const filtered = filters({
    classes: classes.value,
    mostSigma: mostSigma.value,
    leastDrives: leastDrives.value,
  });
  const unmeasured = colour.value === "elevation-model";
  return (
    <details class="legend card" open={!narrow}>
      <summary>
        <h2>{t(`map.colour.${colour.value}` as TextKey)}</h2>
        {narrow && shades && (
          <span class="strip" aria-hidden="true">
            {shades.classes.map((one) => (
              <span key={one.colour} style={{ background: one.colour }} />
            ))}
          </span>
        )}
      </summary>
      <Hint />
      <Count />
      <ul class="classes" aria-label={t("map.classes")}>
        {shades?.classes.map((one, k) => (
          <ClassButton key={one.from_percent} one={k} name={nameOf(one)} shade={one.colour} />
        ))}
        {shades && <ClassButton one="unknown" name={t("map.unknown")} shade={shades.unknown} />}
      </ul>
      <Slider
        name={t("map.most_sigma")}
        steps={[...SIGMAS, null]}
        value={mostSigma.value}
        describe={(value) => (value === null ? t("map.any") : `± ${number(value, value < 1 ? 2 : 1)} %`)}
        choose={(value) => {
          mostSigma.value = value;
        }}
        disabled={unmeasured}
      />
      <Slider
        name={t("map.least_drives")}
        steps={DRIVES}
        value={leastDrives.value}
        describe={(value) => (value ? number(value) : t("map.any"))}
        choose={(value) => {
          leastDrives.value = value ?? 0;
        }}
        disabled={unmeasured}
      />
      {filtered && (
        <button
          type="button"
          onClick={() => {
            classes.value = [];
            mostSigma.value = null;
            leastDrives.value = 0;
          }}
        >
          {t("map.show_all")}
        </button>
      )}
      <Choices />
      <p class="quiet-text signs">{t("map.signs")}</p>
    </details>
  );
}
