// Shows the scene of an object's page: loads its meshes when they are wanted, turns them, and shows and hides their parts.
"use strict";
(() => {
  const waiting = {};
  const HAND_OPACITY = 0.5;  // the object is seen through the hand

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
    return new THREE.GLTFLoader().parseAsync(glb, "");
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
    let predictions;
    const isBeside = () => Boolean(predictions && chosen("prediction").value && chosen("beside").checked);
    const draw = () => {  // a prediction has a view of its own beside the object's, seen from the same side
      const { clientWidth, clientHeight } = canvas, views = isBeside() ? [[scene], [predictions]] : [[scene, predictions]];
      renderer.setSize(clientWidth, clientHeight, false);
      const width = clientWidth / views.length;
      camera.aspect = width / clientHeight;
      camera.updateProjectionMatrix();
      renderer.setScissorTest(true);
      views.forEach((shown, place) => {
        scene.children.forEach((child) => { if (child.isGroup) child.visible = shown.includes(child === predictions ? child : scene); });
        renderer.setViewport(place * width, 0, width, clientHeight);
        renderer.setScissor(place * width, 0, width, clientHeight);
        renderer.render(scene, camera);
      });
    };
    controls.addEventListener("change", draw);
    new ResizeObserver(draw).observe(canvas);

    const boxOf = (node) => new THREE.Box3().setFromObject(node);
    const cornersOf = (node, corners = []) => {
      node.updateWorldMatrix(true, true);
      node.traverse((mesh) => {
        if (!mesh.isMesh) return;
        mesh.geometry.computeBoundingBox();
        const { min, max } = mesh.geometry.boundingBox;
        for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z])
          corners.push(new THREE.Vector3(x, y, z).applyMatrix4(mesh.matrixWorld));
      });
      return corners;
    };

    // Look from beside the hand, so that it hides little, and from where object and hand just fit into the view.
    const reset = () => {
      const grasp = chosen("grasp").value, object = scene.getObjectByName("object"), middle = boxOf(object).getCenter(new THREE.Vector3());
      const hand = boxOf(scene.getObjectByName(`grasp-${grasp}-sensors`)).getCenter(new THREE.Vector3()).sub(middle);
      const high = new THREE.Vector3(0, 1, 0), across = hand.normalize().clone().cross(high);
      if (across.length() < 0.3) across.set(1, 0, 0);  // the hand is above or below
      const toward = across.normalize().addScaledVector(hand, 0.45).addScaledVector(high, 0.3).normalize();
      const right = high.clone().cross(toward).normalize(), up = toward.clone().cross(right);
      const shown = [object, scene.getObjectByName(`grasp-${grasp}-hand`)].filter((node) => node && node.visible);
      const corners = shown.flatMap((node) => cornersOf(node)).map((corner) => corner.sub(middle));
      const height = Math.tan(camera.fov * Math.PI / 360), target = middle.clone();
      const distances = [[right, height * camera.aspect], [up, height]].map(([axis, slope]) => {
        const reach = (sign) => Math.max(...corners.map((corner) => sign * corner.dot(axis) / slope + corner.dot(toward)));
        target.addScaledVector(axis, slope * (reach(1) - reach(-1)) / 2);
        return (reach(1) + reach(-1)) / 2;
      });
      controls.target.copy(target);
      camera.position.copy(target).addScaledVector(toward, 1.04 * Math.max(...distances));
      controls.update();
      draw();
    };

    const show = async () => {
      const grasp = chosen("grasp").value, prediction = chosen("prediction")?.value;
      if (prediction && !predictions) {
        said.textContent = "Loading predictions.";
        predictions = (await parse(root.dataset.predictions)).scene;
        scene.add(predictions);
      }
      const parts = [...root.querySelectorAll("fieldset input:checked")].map((box) => box.value);
      const shown = new Set(parts.filter((part) => part !== "beside"));
      scene.traverse((node) => {
        const [, number, part] = /^grasp-(\d+)-(\w+)$/.exec(node.name) ?? [];
        if (number) node.visible = number === grasp && shown.has(part);
        if (node.name === "object") node.visible = shown.has("object");
      });
      predictions?.children.forEach((top) => top.traverse((node) => {
        if (node.name.startsWith("prediction-") && node.children.length) node.visible = node.name === `prediction-${prediction}`;
      }));
      const where = isBeside() ? "; on the right: " : ", ";
      said.textContent = `Grasp ${Number(grasp) + 1}. Shown: ${[...shown].join(", ") || "nothing"}${prediction ? `${where}prediction ${prediction}` : ""}.`;
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
    const { scene: grasps } = await parse(root.dataset.mesh);
    scene.add(grasps);

    root.addEventListener("change", async (event) => {
      await show();
      if (["grasp", "beside", "prediction"].includes(event.target.name)) reset();
    });
    scene.traverse((node) => {
      if (/^grasp-\d+-hand$/.test(node.name)) node.traverse(({ material }) => {
        if (material) Object.assign(material, { transparent: true, opacity: HAND_OPACITY });
      });
    });
    await show();
    draw();
    reset();
    root.querySelector(".stage img").hidden = true;
    root.dataset.ready = performance.now().toFixed(0);
  };

  document.querySelectorAll(".viewer").forEach((root) => start(root).catch((error) => {
    root.querySelector("[role=status]").textContent = `The object cannot be shown in 3D here (${error.message}); the picture shows it.`;
  }));
})();
