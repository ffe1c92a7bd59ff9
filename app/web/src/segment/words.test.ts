import { expect, test } from "vitest";
import { besideModel } from "./words";

test("of a fall it is said which is the steeper, not which number is less", () => {
  expect(besideModel(-2, -9, true)).toBe("−9.0 %, 7.0 points steeper than measured");
  expect(besideModel(-9, -2, true)).toBe("−2.0 %, 7.0 points flatter than measured");
  expect(besideModel(2, 9, true)).toBe("+9.0 %, 7.0 points steeper than measured");
  expect(besideModel(3, -3, true)).toBe("−3.0 %, the other way than measured");
  expect(besideModel(-0.04, 3, false)).toBe("+3.0 %, 3.0 points steeper than what follows from both sides");
  expect(besideModel(3, 3.04, true)).toBe("+3.0 %, the same as measured");
});
