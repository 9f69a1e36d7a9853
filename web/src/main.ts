// The operator's page: each panel on its own, joined by the App's cells and channels.

import { App } from "./app";
import { byId } from "./dom";
import { Hands } from "./hands";
import { mountBlindBanner, mountLinkBanner, mountNotices } from "./panels/banner";
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
import { mountViewer, reloadViewer } from "./panels/viewer";
import { Telemetry } from "./telemetry";
import { Teleop } from "./teleop";
import { startTheme } from "./theme";
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/layout.css";
import "./styles/panels.css";
import "./styles/player.css";

function start(): void {
  const app = new App();
  const telemetry = new Telemetry(app);
  startTheme(() => app.theme.emit());

  const estop = new EStop(app);
  listenForStopKeys(window, app, estop);
  mountTopbar(app, mountHelp());
  mountBlindBanner(app);
  mountLinkBanner(app);
  mountNotices(app);
  mountSource(app);
  mountGaits(app);
  mountParameters(app);
  const hands = new Hands(app, (reason) => estop.press(reason));
  const teleop = new Teleop(app, (detail) => {
    hands.releaseAll(null);
    app.notice.emit({ level: "error", text: detail });
  });
  const arrowsFor = (element: Element) => element === document.body || element.closest("#pad") !== null;
  hands.listen(window, arrowsFor);
  mountDrive(app, hands, teleop);
  mountViewer(app, (frame) => {
    listenForStopKeys(frame, app, estop);
    // The arrows move the view there.
    hands.listen(frame, () => false);
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
  mountSignIn(app, () => {
    telemetry.reconnect();
    reloadViewer();
  });
  app.link.watch(({ phase }) => {
    if (phase === "live") void app.loadRole();
    if (phase === "live" && app.catalogue.get().length === 0) void app.loadCatalogue();
  });
  // The gaits' defaults depend on the robot.
  let robot = "";
  app.state.watch((state) => {
    if (!state || state.source.kind === "recording") return;
    if (robot !== "" && state.robot.model !== robot) void app.loadCatalogue();
    robot = state.robot.model;
  });
  let session = -1;
  app.state.watch((state) => {
    if (!state || state.session_number === session) return;
    if (session >= 0) app.cleared.emit();
    session = state.session_number;
  });
  telemetry.start();
}

start();
