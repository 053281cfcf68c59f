// Asks for the camera of the device that shows the page, and sends its images over the page's own connection.
// Each message is the time of the image [s], 8 bytes, and a JPEG. The answer asks for the next one.

/** Sends images to `address`, no longer than `side` pixels, and calls `ended` with the reason when that ends. */
const sender = (address, side, ended) => {
    const socket = new WebSocket(address);
    const canvas = new OffscreenCanvas(1, 1);
    let busy = false;
    socket.onmessage = () => (busy = false);
    socket.onclose = (event) => ended(event.reason || "The connection has ended.");
    const send = async (image, width, height, seconds) => {
        if (busy || socket.readyState !== WebSocket.OPEN) return;
        busy = true;
        const scale = Math.min(1, side / Math.max(width, height));
        canvas.width = Math.round(scale * width);
        canvas.height = Math.round(scale * height);
        canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
        const time = new DataView(new ArrayBuffer(8));
        time.setFloat64(0, seconds, true);
        socket.send(new Blob([time, await canvas.convertToBlob({ type: "image/jpeg", quality: 0.92 })]));
    };
    return { send, close: () => ((socket.onclose = null), socket.close()) };
};

/** As a worker: each image of a stream is sent, however slowly the page is drawn. */
const asWorker = () => {
    onmessage = async ({ data: { stream, address, side } }) => {
        const { send } = sender(address, side, postMessage);
        const images = stream.getReader();
        for (let one; (one = (await images.read()).value); one.close())
            send(one, one.displayWidth, one.displayHeight, one.timestamp / 1e6);
    };
};

/** In the page: the person is asked first. */
const inPage = () => {
    const { width, height, kept, board } = document.currentScript.dataset;
    const side = Math.max(width, height);
    const here = location.href.split(/[?#]/)[0].replace(/\/?$/, "/");
    const card = document.createElement("section");
    card.id = "device";
    card.innerHTML = `<style>
        #device { position: fixed; z-index: 9999; font: 15px/1.4 system-ui, sans-serif; color: #222; background: #fff;
            border-radius: 10px; box-shadow: 0 2px 16px #0006; }
        #device.asking { left: 50%; top: 50%; transform: translate(-50%, -50%); width: min(24em, 82vw); padding: 18px; }
        #device:not(.asking) { left: 8px; top: 8px; padding: 4px 10px; }
        #device:not(.asking) .ask { display: none; }
        #device h2 { font-size: 20px; margin: 0 0 8px; } #device p { margin: 0 0 10px; }
        #device button { font: inherit; padding: 8px 14px; border-radius: 8px; border: 1px solid #0072B2; }
        #device #film { background: #0072B2; color: #fff; } #device #stop { border: 0; background: none; color: #D55E00; }
    </style>
    <h2 class="ask">Use this device's camera?</h2>
    <p class="ask">Its images go to the computer that serves this page, and nowhere else. <span id="kept"></span></p>
    <p class="ask" id="wave" hidden>First the camera is calibrated: print <a href="board.svg" target="_blank">this
        board</a> at 100 %, glue it on something flat, and wave it before the camera, as the page then says.</p>
    <p class="ask" id="trouble" role="alert"></p>
    <button class="ask" id="film">Film</button> <button class="ask" id="watch">Only watch</button>
    <span id="filming" hidden>● Filming<span id="facing">. If the camera faces you, its right is to your left.</span>
        <button id="stop">Stop</button></span>`;
    const part = (id) => card.querySelector("#" + id);
    part("kept").textContent = kept;
    part("wave").hidden = !board;
    let stream, stop;

    const ask = (trouble) => {
        stream?.getTracks().forEach((track) => track.stop());
        stop?.();
        stream = stop = undefined;
        part("trouble").textContent = trouble;
        part("filming").hidden = true;
        card.className = "asking";
    };

    const film = async () => {
        if (!navigator.mediaDevices) return ask("A browser gives its camera to https addresses and to localhost alone.");
        const size = { width: { ideal: +width }, height: { ideal: +height }, frameRate: { ideal: 30 } };
        const which = { audio: false, video: { ...size, facingMode: { ideal: "environment" } } };
        try {
            stream = await navigator.mediaDevices.getUserMedia(which);
        } catch (error) {
            const causes = { NotAllowedError: "The camera was not allowed.", NotFoundError: "This device has no camera." };
            return ask(causes[error.name] ?? `The camera cannot be used: ${error.message}`);
        }
        const [track] = stream.getVideoTracks();
        track.onended = () => ask("The camera has stopped.");
        const address = here.replace(/^http/, "ws") + "device";
        stop = window.MediaStreamTrackProcessor ? inWorker(track, address) : byVideo(address);
        navigator.wakeLock?.request("screen").catch(() => {});
        part("facing").hidden = track.getSettings().facingMode === "environment";
        part("filming").hidden = false;
        card.className = "";
    };

    const inWorker = (track, address) => {
        const worker = new Worker(here + "device.js");
        const images = new MediaStreamTrackProcessor({ track }).readable;
        worker.onmessage = (event) => ask(event.data);
        worker.postMessage({ stream: images, address, side }, [images]);
        return () => worker.terminate();
    };

    const byVideo = (address) => {
        const video = Object.assign(document.createElement("video"), { muted: true, playsInline: true });
        const { send, close } = sender(address, side, ask);
        const shown = (now, image) => {
            send(video, video.videoWidth, video.videoHeight, (image.captureTime ?? now) / 1e3);
            if (stream) video.requestVideoFrameCallback(shown);
        };
        video.srcObject = stream;
        video.requestVideoFrameCallback(shown);
        video.play();
        return close;
    };

    part("film").onclick = ({ target }) => {
        target.disabled = true; // a second tap would open the camera once more
        film().finally(() => (target.disabled = false));
    };
    part("stop").onclick = () => ask("");
    part("watch").onclick = () => (card.hidden = true);
    addEventListener("DOMContentLoaded", () => document.body.append(card));
    ask("");
};

self.document ? inPage() : asWorker();
