/** The ride in figures, and its climbs: what is pointed at shows on map and charts, what is chosen is zoomed to. */
import type { ComponentChildren } from "preact";
import { distance, duration, number } from "../shared/format";
import { t } from "../shared/texts";
import type { Climb, RideStretch } from "./data";
import { choose, chosen, nameOf, point, ride } from "./ride";
import { hasResult } from "./state";

/** A figure with its sigma. */
function sure(value: number | null, sigma: number | null, unit: string, decimals = 0): string {
  const doubt = value === null || sigma === null ? "" : ` ± ${number(sigma, decimals)}`;
  return `${number(value, decimals)}${doubt} ${unit}`;
}

/** A grade in words: its direction is not a sign. */
function grade(one: RideStretch): string {
  const size = sure(Math.abs(one.percent), one.sigma_percent, "%", 1);
  return t(one.percent < 0 ? "drive.ride.down" : "drive.ride.up", { grade: size });
}

const road = (one: RideStretch) => one.name ?? t("drive.ride.unnamed");

function Choice({ name, kind, children }: { name: string; kind: string; children: ComponentChildren }) {
  const on = chosen.value === name;
  return (
    <button
      type="button"
      class={`quiet ${kind}`}
      aria-pressed={on}
      onClick={() => choose(on ? null : name)}
      onPointerEnter={() => point(name)}
      onPointerLeave={() => point(null)}
      onFocus={() => point(name)}
      onBlur={() => point(null)}
    >
      {children}
    </button>
  );
}

function Figure({ name, children }: { name: string; children: ComponentChildren }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>{children}</dd>
    </div>
  );
}

export function RideFigures() {
  const of = ride.value;
  if (!of) return null;
  return (
    <dl class="figures ride-figures" aria-label={t("drive.ride.title")}>
      <Figure name={t("drive.ride.distance")}>{distance(of.distance_m)}</Figure>
      <Figure name={t("drive.ride.time")}>{duration(of.duration_s)}</Figure>
      <Figure name={t("drive.ride.ascent")}>{sure(of.ascent_m, of.ascent_sigma_m, "m")}</Figure>
      <Figure name={t("drive.ride.descent")}>{sure(of.descent_m, of.descent_sigma_m, "m")}</Figure>
      {of.steepest && (
        <Figure name={t("drive.ride.steepest")}>
          <Choice name={nameOf(null)} kind="name">
            {grade(of.steepest)}
          </Choice>
          {hasResult.value && <small>{road(of.steepest)}</small>}
        </Figure>
      )}
    </dl>
  );
}

function Details({ climb }: { climb: Climb }) {
  const km = (metres: number) => number(metres / 1000, 1);
  return (
    <>
      <b>
        {climb.category
          ? t("drive.ride.category", { category: climb.category })
          : t("drive.ride.no_category")}
        {hasResult.value && ` · ${road(climb)}`}
      </b>
      <span>
        {t("drive.ride.climb", {
          from: km(climb.from_m),
          to: km(climb.to_m),
          length: distance(climb.length_m),
          gain: number(climb.gain_m),
          mean: sure(climb.percent, climb.sigma_percent, "%", 1),
          most: `${number(climb.maximum_percent, 1)} %`,
        })}
      </span>
    </>
  );
}

export function Climbs() {
  const of = ride.value;
  if (!of) return null;
  return (
    <section class="card" aria-labelledby="climbs">
      <h2 id="climbs">{t("drive.ride.climbs")}</h2>
      {of.climbs.length === 0 ? (
        <p class="quiet-text">{t("drive.ride.none")}</p>
      ) : (
        <>
          <p class="quiet-text">{t("drive.ride.how")}</p>
          <ol class="climbs">
            {of.climbs.map((one) => (
              <li key={one.from_m}>
                <Choice name={nameOf(one)} kind="climb">
                  <Details climb={one} />
                </Choice>
              </li>
            ))}
          </ol>
        </>
      )}
      <p class="quiet-text small">{t("drive.ride.rule", { least: number(of.least_rise_m) })}</p>
    </section>
  );
}
