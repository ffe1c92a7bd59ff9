import { beforeAll, describe, expect, it, vi } from "vitest";

beforeAll(() => {
  vi.stubGlobal("document", { documentElement: {} });
});

const REPORT = {
  format: "csv",
  epochs: 600,
  distance_m: 5706.2,
  duration_s: 599,
  matched_share: 0.98,
  breaks: [{ time_s: 1_700_000_000, reason: "no road near" }],
  segments_estimated: 107,
  median_slope_sigma_percent: 0.306,
  rejected_segments: 3,
  noise: { altitude_m: 0.414, baro_m: 0.3, doppler: 0.73 },
  mount: { pitch_deg: -1.819, sigma_deg: 0.055, moves: [{ time_s: 1_700_000_060, change_deg: 2 }] },
  inertia: { imu_lag_s: 0, found_imu_lag_s: null, mount_yaw_deg: 0, found_mount_yaw_deg: null },
  sensors: {
    altitude: { measurements: 600, outliers: 0, grade_sigma_percent: 0.39, grade_sigma_percent_without: 0.4 },
    doppler: { measurements: 549, outliers: 2, grade_sigma_percent: 0.39, grade_sigma_percent_without: 0.57 },
  },
  gnss: { positioning: "receiver" },
  dem: null,
  warnings: ["Look here."],
  something_new: { of_a_later: 1.23456789 },
};

describe("a report", async () => {
  const { allFigures, sentencesOf } = await import("./sentences");
  const { remarksOf } = await import("../shared/remarks");
  const sentences = Object.fromEntries(sentencesOf(REPORT));

  it("has remarks that ask for something, and others, by their keys alone", () => {
    const said = [
      { key: "drive.few_on_roads", parameters: { share: 0.45 } },
      { key: "drive.no_doppler", parameters: { advice: { key: "advice.gpx_doppler", parameters: {} } } },
      { key: "drive.height_jump", parameters: { clock: "22:13:20 UTC" } },
    ];
    const remarks = remarksOf({
      warnings: ["Import.", "No.", "It jumped.", "Look here."],
      warnings_said: said,
    });
    expect(remarks.map((one) => one.asks)).toEqual([true, true, false, false]);
  });
  it("is sentences in sentences", () => {
    expect(sentences["result"]).toContain("107 segments got a slope; half of them have a sigma below 0.3 %.");
    expect(sentences["result"]).toContain(
      "It contradicts other drives on 3 segments, and is rejected there.",
    );
    expect(sentences["matching"]).toEqual([
      "98 % of the positions lie on known roads.",
      "At 22:13:20 UTC the path ends: no road is near.",
    ]);
    expect(sentences["mount"]).toEqual([
      "The sensor is tilted down by 1.82 ± 0.06 degrees, which was taken off.",
      "It moved by 2.0 degrees at 22:14:20 UTC.",
      "Nothing shows whether inertial data come late.",
      "Nothing shows whether the sensor is turned sideways.",
    ]);
    expect(sentences["heights"]).toEqual(["No elevation model took part."]);
  });

  it("says the noise of sensors that took part, and the most useful sensor first", () => {
    expect(sentences["noise"]).toEqual([
      "GNSS altitudes scatter by 0.41 m.",
      "Vertical velocities scatter by 0.7 times the accuracy that the log states.",
    ]);
    expect(sentences["sensors"]?.[0]).toContain("vertical Doppler: 549 measurements, of which 2 are far off");
  });

  it("keeps what nobody says in the table, and warnings apart", () => {
    const rows = Object.fromEntries(allFigures(REPORT));
    expect(rows["something_new.of_a_later"]).toBe("1.23457");
    expect(rows["warnings"]).toBeUndefined();
    expect(remarksOf(REPORT)).toEqual([{ text: "Look here.", key: null, asks: false }]);
    expect(remarksOf(null)).toEqual([]);
  });

  it("calls what a log lacks by its name", () => {
    const missing = ["fix.height_ell_m", "velocity.s_acc_mps", "velocity.vel_d_mps", "pressure"];
    expect(Object.fromEntries(sentencesOf({ missing }))["log"]).toEqual([
      "The log lacks: height above the ellipsoid, a part of: velocities of the GNSS, air pressure.",
    ]);
  });

  it("bears a report of another version", () => {
    expect(() => sentencesOf({ mount: 3, sensors: null, breaks: null, noise: "none" })).not.toThrow();
    expect(sentencesOf({})).toEqual([]);
  });

  it("has each sentence in every language", async () => {
    const en = (await import("../texts/en.json")).default.drive;
    const de = (await import("../texts/de.json")).default.drive;
    const keys = (of: object, path = ""): string[] =>
      Object.entries(of).flatMap(([key, inner]) =>
        typeof inner === "string" ? [path + key] : keys(inner as object, `${path}${key}.`),
      );
    expect(keys(de).sort()).toEqual(keys(en).sort());
  });
});
