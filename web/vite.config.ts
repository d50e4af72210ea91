import { defineConfig } from "vite";

const PAGES = {
  operate: { input: "index.html", base: "/", outDir: "packages/minorloop-head/src/minorloop_head/console/static" },
  lab: { input: "lab.html", base: "/lab/", outDir: "packages/minorloop/src/minorloop/page/static" },
};

export default defineConfig(({ mode }) => {
  const { input, base, outDir } = PAGES[mode === "lab" ? "lab" : "operate"];
  return {
    base,
    build: {
      outDir: `../${outDir}`,
      emptyOutDir: true,
      target: "es2022",
      chunkSizeWarningLimit: 900,
      license: { fileName: "licenses.txt" },
      rollupOptions: { input },
    },
  };
});
