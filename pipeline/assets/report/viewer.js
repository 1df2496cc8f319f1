// Shows the scene of an object's page: loads its meshes when they are wanted, turns them, and shows and hides their parts.
"use strict";
(() => {
  const waiting = {};

  // A mesh file is a script that calls this with its name and its content: gzip, base64. Browsers fetch no files from a disk.
  window.vtMesh = (name, content) => waiting[name](content);

  const load = (name) => new Promise((resolve, reject) => {
    waiting[name] = resolve;
    const script = document.createElement("script");
    script.src = name;
    script.onerror = () => reject(new Error(`${name} is missing`));
    document.head.append(script);
  });

  const parse = async (name) => {
    const bytes = Uint8Array.from(atob(await load(name)), (one) => one.charCodeAt(0));
    const glb = await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
    return (await new THREE.GLTFLoader().parseAsync(glb, "")).scene;
  };

  const start = async (root) => {
    const canvas = root.querySelector("canvas"), said = root.querySelector("[role=status]");
    const chosen = (name) => root.querySelector(`[name=${name}]`);
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(35, 4 / 3, 0.01, 20);
    const lamp = new THREE.DirectionalLight(0xffffff, 1.6);
    scene.add(new THREE.HemisphereLight(0xffffff, 0x777777, 1.7), camera);
    camera.add(lamp);
    const controls = new THREE.OrbitControls(camera, canvas);
    const draw = () => {
      const { clientWidth, clientHeight } = canvas;
      renderer.setSize(clientWidth, clientHeight, false);
      camera.aspect = clientWidth / clientHeight;
      camera.updateProjectionMatrix();
      renderer.render(scene, camera);
    };
    controls.addEventListener("change", draw);
    new ResizeObserver(draw).observe(canvas);

    const reset = () => {
      const ballOf = (node) => new THREE.Box3().setFromObject(node).getBoundingSphere(new THREE.Sphere());
      const ball = ballOf(scene.getObjectByName("object"));
      const away = ballOf(scene.getObjectByName(`grasp-${chosen("grasp").value}-sensors`)).center.sub(ball.center);
      const azimuth = Math.atan2(away.x, away.z) + 0.9;  // from beside the hand: it hides little, and little hides it
      controls.target.copy(ball.center);
      away.set(Math.sin(azimuth), 0.5, Math.cos(azimuth)).normalize().multiplyScalar(1.1 * ball.radius / Math.sin(0.3));
      camera.position.copy(ball.center).add(away);
      controls.update();
    };

    let predictions;
    const show = async () => {
      const grasp = chosen("grasp").value, prediction = chosen("prediction")?.value;
      if (prediction && !predictions) {
        said.textContent = "Loading predictions.";
        predictions = await parse(root.dataset.predictions);
        scene.add(predictions);
      }
      const shown = new Set([...root.querySelectorAll("input:checked")].map((box) => box.value));
      scene.traverse((node) => {
        const [, number, part] = /^grasp-(\d+)-(\w+)$/.exec(node.name) ?? [];
        if (number) node.visible = number === grasp && shown.has(part);
        if (node.name === "object") node.visible = shown.has("object");
      });
      predictions?.children.forEach((top) => top.traverse((node) => {
        if (node.name.startsWith("prediction-") && node.children.length) node.visible = node.name === `prediction-${prediction}`;
      }));
      said.textContent = `Grasp ${Number(grasp) + 1}. Shown: ${[...shown].join(", ") || "nothing"}${prediction ? `, prediction ${prediction}` : ""}.`;
      draw();
    };

    const turn = (around, up) => {
      const offset = camera.position.clone().sub(controls.target), length = offset.length();
      const azimuth = Math.atan2(offset.x, offset.z) + around;
      const height = Math.max(-1.5, Math.min(1.5, Math.asin(offset.y / length) + up));
      offset.set(Math.sin(azimuth) * Math.cos(height), Math.sin(height), Math.cos(azimuth) * Math.cos(height)).multiplyScalar(length);
      camera.position.copy(controls.target).add(offset);
      controls.update();
    };
    const zoom = (factor) => { camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target); controls.update(); };
    const keys = {
      ArrowLeft: () => turn(-0.15, 0), ArrowRight: () => turn(0.15, 0), ArrowUp: () => turn(0, 0.15), ArrowDown: () => turn(0, -0.15),
      "+": () => zoom(0.85), "-": () => zoom(1.18), r: reset,
    };
    canvas.addEventListener("keydown", (event) => {
      if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
    });
    root.addEventListener("change", show);

    scene.add(await parse(root.dataset.mesh));
    await show();
    reset();
    draw();
    root.querySelector(".stage img").hidden = true;
    root.dataset.ready = performance.now().toFixed(0);
  };

  document.querySelectorAll(".viewer").forEach((root) => start(root).catch((error) => {
    root.querySelector("[role=status]").textContent = `The object cannot be shown in 3D here (${error.message}); the picture shows it.`;
  }));
})();
