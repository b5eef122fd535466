export * from "linktwin-page/clock.js";
export * from "linktwin-page/colours.js";
export { Stage } from "linktwin-page/stage.js";
