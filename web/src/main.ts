// The operator's page: each panel on its own, joined by the App's cells and channels.

// The panels' own styles come between those of the whole page and those that fit everything to a screen.
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/layout.css";
import { App } from "./app/app";
import { byId } from "./basics/dom";
import { watchFailures } from "./link/failure";
import { DeadmanInput } from "./app/deadman-input";
import { mountBlindBanner, mountLinkBanner, mountNotices, mountStatusLine, mountTakenBanner } from "./panels/banner";
import { mountCamera } from "./panels/camera";
import { mountDrive } from "./panels/drive";
import { EStop, listenForStopKeys } from "./panels/estop";
import { mountEstimator } from "./panels/estimator";
import { mountEvents } from "./panels/events";
import { mountGaits } from "./panels/gaits";
import { mountHead } from "./panels/head";
import { mountHeadControl } from "./panels/headcontrol";
import { mountHelp } from "./panels/help";
import { mountJoints } from "./panels/joints";
import { mountPlayer } from "./panels/player";
import { mountParameters } from "./panels/parameters";
import { mountPatrol } from "./panels/patrol";
import { mountRuns } from "./panels/runs";
import { mountSignIn } from "./panels/signin";
import { mountSource } from "./panels/source";
import { mountTabs } from "./panels/tabs";
import { mountTopbar } from "./panels/topbar";
import { mountViewer } from "./panels/viewer";
import { Telemetry } from "./app/telemetry";
import { Teleop } from "./app/teleop";
import { startTheme } from "./basics/theme";
import "./styles/link-down.css";
import "./styles/screens.css";

/** Nothing that the server says is read only once: it may restart with another configuration, or the sign-in change. */
function keepFresh(app: App): void {
  app.link.watch(({ phase }) => phase === "live" && void app.reload());
  // Another tab of this browser may have signed in as somebody else.
  document.addEventListener("visibilitychange", () => {
    if (!document.hidden && app.link.get().phase === "live") void app.loadRole();
  });
  // The gaits' defaults depend on the robot and on the session's settings.
  let known = "";
  app.state.watch((state) => {
    if (state?.session !== "running" || state.source.kind === "recording") return;
    const now = JSON.stringify([state.session_number, state.source, state.robot]);
    if (known !== "" && now !== known) void app.loadCatalogue();
    known = now;
  });
}

function start(): void {
  const app = new App();
  watchFailures((error) => app.report(error));
  const telemetry = new Telemetry(app);
  startTheme(() => app.theme.emit());

  const estop = new EStop(app);
  listenForStopKeys(window, estop);
  mountTopbar(app, mountHelp());
  mountBlindBanner(app);
  mountLinkBanner(app);
  mountTakenBanner(app);
  mountNotices(app);
  mountStatusLine(app);
  mountSource(app);
  mountGaits(app);
  mountParameters(app);
  const deadman = new DeadmanInput(app, (reason) => estop.press(reason));
  const refused = (detail: string) => {
    deadman.releaseAll(null);
    app.notice.emit({ level: "error", text: detail });
  };
  const teleop = new Teleop(app, refused, () => deadman.releaseAll("this page was frozen for a moment"));
  const arrowsFor = (element: Element) => element === document.body || element.closest("#pad") !== null;
  deadman.listen(window, arrowsFor);
  mountDrive(app, deadman, teleop);
  mountViewer(app, (frame) => {
    listenForStopKeys(frame, estop);
    // The arrows move the view there.
    deadman.listen(frame, () => false);
  });
  mountPatrol(app);
  mountPlayer(app);
  mountCamera(app, telemetry);
  mountEstimator(app);
  mountHead(app);
  mountHeadControl(app);
  mountTabs(byId("dock-tabs"));
  mountJoints(app);
  mountRuns(app);
  mountEvents(app);
  mountSignIn(app, () => telemetry.reconnect());
  keepFresh(app);
  let session = -1;
  app.state.watch((state) => {
    if (!state || state.session_number === session) return;
    if (session >= 0) app.cleared.emit();
    session = state.session_number;
  });
  telemetry.start();
}

start();
