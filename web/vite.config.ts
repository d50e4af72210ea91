import { defineConfig } from "vite";

export default defineConfig({
  base: "/",
  build: {
    outDir: "../packages/minorloop-head/src/minorloop_head/console/static",
    emptyOutDir: true,
    target: "es2022",
    chunkSizeWarningLimit: 900,
    license: { fileName: "licenses.txt" },
    rollupOptions: { input: ["index.html", "lab.html"] },
  },
});
