/** What such a recording is for and what it is not: before it begins, and while it runs. */
import { t } from "../shared/texts";
import { running } from "./recorder";

export function Limits() {
  const runs = running.value !== null;
  return (
    <section class="limits card" aria-labelledby="limits">
      <h2 id="limits">{t(runs ? "record.limits_now" : "record.limits")}</h2>
      <ul>
        <li>
          <b>{t("record.limit.screen")}</b> {!runs && t("record.limit.screen_why")}
        </li>
        <li>
          <b>{t("record.limit.front")}</b> {!runs && t("record.limit.front_why")}
        </li>
        <li>
          <b>{t("record.limit.barometer")}</b> {!runs && t("record.limit.barometer_why")}
        </li>
        <li>
          <b>{t("record.limit.heights")}</b> {!runs && t("record.limit.heights_why")}
        </li>
      </ul>
      {!runs && (
        <p>
          {t("record.for")} <a href="/docs/how-to/record">{t("record.better")}</a>
        </p>
      )}
    </section>
  );
}
