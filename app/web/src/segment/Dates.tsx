/** Two drives of a street by their dates: what each says of its slope, and whether they differ by more than chance. */
import { useEffect } from "preact/hooks";
import { goTo, search } from "../shared/address";
import { moment, number, slope } from "../shared/format";
import { t } from "../shared/texts";
import type { Observation } from "./data";
import { decimalsOf } from "./words";

/** So many sigmas are passed by one in twenty differences that are none. */
const CHANCE = 1.96;

/** How much more the later one says, its sigma, and how many sigmas that is. The errors of two drives are independent. */
export function difference(earlier: Observation, later: Observation) {
  const percent = later.slope_percent - earlier.slope_percent;
  const sigma = Math.hypot(earlier.slope_sigma_percent, later.slope_sigma_percent);
  return { percent, sigma, sigmas: sigma > 0 ? Math.abs(percent) / sigma : 0 };
}

/** What others have in the address, as they wrote it. */
const others = () => location.search.replace(/([?&])dates=[^&]*&?/, "$1").replace(/[?&]$/, "");

/** Have these dates, which are drives, in the address. */
function write(dates: readonly string[]): void {
  const before = others();
  goTo(`${location.pathname}${before}${before ? "&" : "?"}dates=${dates.join(",")}`);
}

/** Dates are of the street whose panel is open, and of no other. */
function forget(): void {
  if (others() !== location.search) goTo(location.pathname + others(), true);
}

export function Dates({ drives }: { drives: readonly Observation[] }) {
  const sorted = [...drives].sort((a, b) => a.first_at.localeCompare(b.first_at));
  const asked = (new URLSearchParams(search.value).get("dates") ?? "").split(",");
  const one = (n: number, otherwise: Observation | undefined) =>
    sorted.find((each) => each.drive_id === asked[n]) ?? otherwise;
  const [first, second] = [one(0, sorted[0]), one(1, sorted.at(-1))];
  useEffect(() => forget, []);
  if (!first || !second || sorted.length < 2) return null;
  const pair = [first, second] as const;
  const [earlier, later] = first.first_at <= second.first_at ? pair : [second, first];
  const { percent, sigma, sigmas } = difference(earlier, later);
  const choice = (n: 0 | 1) => (
    <label class="date">
      {t(n === 0 ? "segment.dates.first" : "segment.dates.second")}
      <select
        value={pair[n].drive_id}
        onChange={(event) => {
          const id = event.currentTarget.value;
          write(n === 0 ? [id, second.drive_id] : [first.drive_id, id]);
        }}
      >
        {sorted.map((each) => (
          <option key={each.drive_id} value={each.drive_id}>
            {moment(each.first_at)}: {slope(each.slope_percent, each.slope_sigma_percent)}
            {each.accepted === false ? ` (${t("segment.rejected")})` : ""}
          </option>
        ))}
      </select>
    </label>
  );
  return (
    <section aria-labelledby="dates">
      <h3 id="dates">{t("segment.dates.title")}</h3>
      {choice(0)}
      {choice(1)}
      <p role="status">
        {first === second
          ? t("segment.dates.same")
          : t(sigmas > CHANCE ? "segment.dates.more" : "segment.dates.chance", {
              difference: slope(percent, sigma),
              sigmas: number(sigmas, Math.max(1, decimalsOf(sigmas))),
            })}
      </p>
      <p class="quiet-text small">{t("segment.dates.note")}</p>
    </section>
  );
}
