// What a worker does: it is given a scene once, then jobs, and answers each.

let scene = null;
onmessage = ({ data }) => {
  if (data.scene) {
    scene = data.scene;
    for (const key of scene.keys) key.xyz = new Float32Array(key.place.buffer);
    return;
  }
  const result = data.what === "order" ? orderOf(scene, data.t, data.matrix) : picture(scene, data);
  postMessage({ number: data.number, result }, [result.buffer]);
};
