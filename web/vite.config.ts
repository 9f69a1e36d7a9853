import { defineConfig } from "vite";
import schema from "./openapi.json";

// `npm run dev` serves the page alone and hands everything else to a running `snakeslam serve`.
const server = "http://127.0.0.1:8000";

export default defineConfig({
  define: { DEADMAN_MS: schema["x-deadman-ms"] },
  build: {
    target: "es2022",
    assetsInlineLimit: 0,
    rolldownOptions: {
      input: ["index.html", "src/viewer-frame.ts"],
      // The server names it in the viewer's page.
      output: { entryFileNames: ({ name }) => (name === "viewer-frame" ? "[name].js" : "assets/[name]-[hash].js") },
    },
  },
  server: {
    proxy: {
      "/api": { target: server, ws: true },
      "/viewer": { target: server, ws: true },
      "/login": server,
    },
  },
});
