/*
 * A host program on libfreenect, driven by lines on stdin: each is answered by one line on stdout.
 * Frames are written to the file given on the command line: "TICKS BYTES FNV1A-OF-THE-BYTES MISSING-PACKETS".
 * There may be a second device ("use 1"), whose frames are counted alone.
 */
#include <dirent.h>
#include <libfreenect.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define PACKETS 242
#define PACKET_BYTES 1748

static freenect_context *context;
static freenect_device *devices[2], *device;
static int used;
static FILE *frames;
static size_t frame_bytes;
static unsigned long frames_seen, frames_of_second;
static int assemble;
static uint8_t seen[PACKETS], seen_of_next[PACKETS];
static int last_chunk = -1, next_began;
static volatile int opened_in_thread;

static uint64_t fnv1a(const uint8_t *bytes, size_t count) {
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t i = 0; i < count; i++) hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}

static void on_chunk(void *buffer, void *packet, int number, int length, void *user) {
    (void)user;
    if (number < 0 || number >= PACKETS) return;
    /* Without its last packet a frame is complete only when packet 0 of the next one has been handed over. */
    if (number <= last_chunk) next_began = 1;
    last_chunk = number;
    (next_began ? seen_of_next : seen)[number] = 1;
    memcpy((uint8_t *)buffer + number * PACKET_BYTES, packet, (size_t)length);
}

static void on_depth(freenect_device *dev, void *depth, uint32_t ticks) {
    if (dev == devices[1]) {
        frames_of_second++;
        return;
    }
    frames_seen++;
    fprintf(frames, "%u %zu %016llx ", ticks, frame_bytes, (unsigned long long)fnv1a(depth, frame_bytes));
    if (assemble) {
        for (int i = 0; i < PACKETS; i++)
            if (!seen[i]) fprintf(frames, "%d,", i);
        memcpy(seen, seen_of_next, sizeof seen);
        memset(seen_of_next, 0, sizeof seen_of_next);
        if (!next_began) last_chunk = -1;
        next_began = 0;
    }
    fputs("\n", frames);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Handles events until so many more frames came, so many seconds passed, or an error. */
static int run(unsigned long count, double seconds) {
    unsigned long end = frames_seen + count;
    double until = now() + seconds;
    int result = 0;
    while (frames_seen < end && now() < until && result >= 0) {
        struct timeval timeout = {0, 50000};
        result = freenect_process_events_timeout(context, &timeout);
    }
    fflush(frames);
    return result;
}

static int descriptors(void) {
    int count = 0;
    DIR *folder = opendir("/proc/self/fd");
    if (!folder) return -1;
    while (readdir(folder)) count++;
    closedir(folder);
    return count - 3; /* ".", ".." and the folder itself */
}

/* Opens a device in a context of its own. */
static void *open_in_thread(void *serial) {
    freenect_context *other;
    freenect_device *mute;
    if (freenect_init(&other, NULL) < 0) return NULL;
    freenect_select_subdevices(other, FREENECT_DEVICE_CAMERA);
    int result = freenect_open_device_by_camera_serial(other, &mute, serial);
    if (result == 0) freenect_close_device(mute);
    freenect_shutdown(other);
    opened_in_thread = result == 0 ? 1 : -1;
    return NULL;
}

int main(int count, char **arguments) {
    char line[256], name[32], word[64];
    alarm(180); /* a host that hangs fails its test */
    frames = fopen(count > 1 ? arguments[1] : "/dev/null", "w");
    if (!frames) return 2;
    while (fgets(line, sizeof line, stdin)) {
        double number = 0, seconds = 0;
        int result = 0;
        word[0] = 0;
        if (sscanf(line, "%31s %63s", name, word) < 1) continue;
        sscanf(line, "%*s %lf %lf", &number, &seconds);
        if (!strcmp(name, "init")) {
            result = freenect_init(&context, NULL);
            if (result == 0) freenect_select_subdevices(context, FREENECT_DEVICE_CAMERA);
            if (result == 0) freenect_set_log_level(context, FREENECT_LOG_ERROR);
        } else if (!strcmp(name, "subdevices")) {
            freenect_select_subdevices(context, (freenect_device_flags)(int)number);
        } else if (!strcmp(name, "count")) {
            result = freenect_num_devices(context);
        } else if (!strcmp(name, "open")) {
            result = word[0] ? freenect_open_device_by_camera_serial(context, &device, word)
                             : freenect_open_device(context, &device, 0);
            devices[used] = device;
        } else if (!strcmp(name, "use")) {
            used = number != 0;
            device = devices[used];
        } else if (!strcmp(name, "open-in-thread")) {
            pthread_t thread;
            result = pthread_create(&thread, NULL, open_in_thread, strdup(word));
        } else if (!strcmp(name, "opened-in-thread")) {
            result = opened_in_thread;
        } else if (!strcmp(name, "mode")) {
            freenect_frame_mode mode =
                freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, (freenect_depth_format)(int)number);
            frame_bytes = (size_t)mode.bytes;
            freenect_set_depth_callback(device, on_depth);
            result = freenect_set_depth_mode(device, mode);
        } else if (!strcmp(name, "assemble")) {
            assemble = 1;
            freenect_set_depth_chunk_callback(device, on_chunk);
        } else if (!strcmp(name, "start")) {
            result = freenect_start_depth(device);
        } else if (!strcmp(name, "video")) {
            result = freenect_start_video(device);
        } else if (!strcmp(name, "run")) {
            result = run((unsigned long)number, seconds);
        } else if (!strcmp(name, "sleep")) {
            usleep((useconds_t)(number * 1e6));
        } else if (!strcmp(name, "frames")) {
            result = (int)(used ? frames_of_second : frames_seen);
        } else if (!strcmp(name, "stop")) {
            result = freenect_stop_depth(device);
        } else if (!strcmp(name, "stop-video")) {
            result = freenect_stop_video(device);
        } else if (!strcmp(name, "close")) {
            result = freenect_close_device(device);
        } else if (!strcmp(name, "shutdown")) {
            result = freenect_shutdown(context);
        } else if (!strcmp(name, "tilt")) {
            result = freenect_set_tilt_degs(device, number);
        } else if (!strcmp(name, "led")) {
            result = freenect_set_led(device, (freenect_led_options)(int)number);
        } else if (!strcmp(name, "state")) {
            result = freenect_update_tilt_state(device);
            freenect_raw_tilt_state *state = freenect_get_tilt_state(device);
            printf("%s %d %d %d %d %d\n", name, result, state->accelerometer_x, state->accelerometer_y,
                   state->accelerometer_z, state->tilt_angle);
            fflush(stdout);
            continue;
        } else if (!strcmp(name, "descriptors")) {
            result = descriptors();
        } else {
            return 3;
        }
        printf("%s %d\n", name, result);
        fflush(stdout);
    }
    return 0;
}
